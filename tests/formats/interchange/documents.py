"""Files of other programs as they write them, made up for the tests."""

from __future__ import annotations

import json
from pathlib import Path

EAF = """<?xml version="1.0" encoding="UTF-8"?>
<ANNOTATION_DOCUMENT AUTHOR="" DATE="2026-01-01T00:00:00+00:00" FORMAT="3.0" VERSION="3.0"
    xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"
    xsi:noNamespaceSchemaLocation="http://www.mpi.nl/tools/elan/EAFv3.0.xsd">
  <HEADER MEDIA_FILE="" TIME_UNITS="milliseconds">
    <MEDIA_DESCRIPTOR MEDIA_URL="file:///C:/Users/ann/take.mp4" MIME_TYPE="video/mp4"
        RELATIVE_MEDIA_URL="./take.mp4"/>
    <PROPERTY NAME="lastUsedAnnotationId">9</PROPERTY>
  </HEADER>
  <TIME_ORDER>
    <TIME_SLOT TIME_SLOT_ID="ts1" TIME_VALUE="1000"/>
    <TIME_SLOT TIME_SLOT_ID="ts2"/>
    <TIME_SLOT TIME_SLOT_ID="ts3" TIME_VALUE="3000"/>
    <TIME_SLOT TIME_SLOT_ID="ts4" TIME_VALUE="1200"/>
    <TIME_SLOT TIME_SLOT_ID="ts5" TIME_VALUE="1800"/>
  </TIME_ORDER>
  <TIER LINGUISTIC_TYPE_REF="gesture" TIER_ID="gesture" ANNOTATOR="ann" PARTICIPANT="P1">
    <ANNOTATION><ALIGNABLE_ANNOTATION ANNOTATION_ID="a1" TIME_SLOT_REF1="ts1" TIME_SLOT_REF2="ts3">
      <ANNOTATION_VALUE>deictic</ANNOTATION_VALUE></ALIGNABLE_ANNOTATION></ANNOTATION>
  </TIER>
  <TIER LINGUISTIC_TYPE_REF="phase" TIER_ID="phase@gesture" PARENT_REF="gesture">
    <ANNOTATION><ALIGNABLE_ANNOTATION ANNOTATION_ID="a2" TIME_SLOT_REF1="ts1" TIME_SLOT_REF2="ts2">
      <ANNOTATION_VALUE>preparation</ANNOTATION_VALUE></ALIGNABLE_ANNOTATION></ANNOTATION>
    <ANNOTATION><ALIGNABLE_ANNOTATION ANNOTATION_ID="a3" TIME_SLOT_REF1="ts2" TIME_SLOT_REF2="ts3">
      <ANNOTATION_VALUE>stroke</ANNOTATION_VALUE></ALIGNABLE_ANNOTATION></ANNOTATION>
  </TIER>
  <TIER LINGUISTIC_TYPE_REF="hand" TIER_ID="hand" PARENT_REF="gesture">
    <ANNOTATION><REF_ANNOTATION ANNOTATION_ID="a4" ANNOTATION_REF="a1">
      <ANNOTATION_VALUE>left</ANNOTATION_VALUE></REF_ANNOTATION></ANNOTATION>
  </TIER>
  <TIER LINGUISTIC_TYPE_REF="word" TIER_ID="word" PARENT_REF="gesture">
    <ANNOTATION><REF_ANNOTATION ANNOTATION_ID="a6" ANNOTATION_REF="a1" PREVIOUS_ANNOTATION="a5">
      <ANNOTATION_VALUE>one</ANNOTATION_VALUE></REF_ANNOTATION></ANNOTATION>
    <ANNOTATION><REF_ANNOTATION ANNOTATION_ID="a5" ANNOTATION_REF="a1">
      <ANNOTATION_VALUE>that</ANNOTATION_VALUE></REF_ANNOTATION></ANNOTATION>
  </TIER>
  <LINGUISTIC_TYPE LINGUISTIC_TYPE_ID="gesture" TIME_ALIGNABLE="true" CONTROLLED_VOCABULARY_REF="kinds"/>
  <LINGUISTIC_TYPE LINGUISTIC_TYPE_ID="phase" TIME_ALIGNABLE="true" CONSTRAINTS="Time_Subdivision"
      CONTROLLED_VOCABULARY_REF="phases"/>
  <LINGUISTIC_TYPE LINGUISTIC_TYPE_ID="hand" TIME_ALIGNABLE="false" CONSTRAINTS="Symbolic_Association"/>
  <LINGUISTIC_TYPE LINGUISTIC_TYPE_ID="word" TIME_ALIGNABLE="false" CONSTRAINTS="Symbolic_Subdivision"/>
  <CONTROLLED_VOCABULARY CV_ID="kinds">
    <DESCRIPTION LANG_REF="und"/>
    <CV_ENTRY_ML CVE_ID="c0"><CVE_VALUE LANG_REF="und" DESCRIPTION="">deictic</CVE_VALUE></CV_ENTRY_ML>
    <CV_ENTRY_ML CVE_ID="c1"><CVE_VALUE LANG_REF="und" DESCRIPTION="">beat</CVE_VALUE></CV_ENTRY_ML>
  </CONTROLLED_VOCABULARY>
  <CONTROLLED_VOCABULARY CV_ID="phases" DESCRIPTION="">
    <CV_ENTRY DESCRIPTION="">preparation</CV_ENTRY>
    <CV_ENTRY DESCRIPTION="">stroke</CV_ENTRY>
  </CONTROLLED_VOCABULARY>
</ANNOTATION_DOCUMENT>
"""
CVAT = """<?xml version="1.0" encoding="utf-8"?>
<annotations>
  <version>1.1</version>
  <meta>
    <job>
      <size>90</size><mode>interpolation</mode>
      <original_size><width>640</width><height>480</height></original_size>
      <source>take.mp4</source>
    </job>
    <dumped>2026-01-01 00:00:00</dumped>
  </meta>
  <track id="0" label="cube" source="manual">
    <box frame="3" keyframe="1" outside="0" occluded="0" xtl="10.00" ytl="20.50" xbr="30.25" ybr="40.00" z_order="0">
      <attribute name="color">red</attribute><attribute name="held">no</attribute>
    </box>
    <box frame="4" keyframe="0" outside="0" occluded="0" xtl="11.00" ytl="20.50" xbr="31.25" ybr="40.00" z_order="0">
      <attribute name="color">red</attribute><attribute name="held">no</attribute>
    </box>
    <box frame="5" keyframe="1" outside="0" occluded="1" xtl="12.00" ytl="20.50" xbr="32.25" ybr="40.00" z_order="2">
      <attribute name="color">red</attribute><attribute name="held">yes</attribute>
    </box>
    <box frame="9" keyframe="1" outside="1" occluded="0" xtl="12.00" ytl="20.50" xbr="32.25" ybr="40.00" z_order="0">
      <attribute name="color">red</attribute><attribute name="held">yes</attribute>
    </box>
  </track>
  <track id="1" label="hand" source="manual">
    <polygon frame="0" keyframe="1" outside="0" occluded="0" points="1.0,2.0;3.0,4.0;5.5,1.0" z_order="0"/>
    <ellipse frame="1" keyframe="1" outside="0" occluded="0" cx="1" cy="2" rx="3" ry="4" z_order="0"/>
  </track>
  <image id="7" name="frame_000007" width="640" height="480">
    <tag label="slide" source="manual"><attribute name="speed">fast</attribute></tag>
    <points label="tip" source="manual" occluded="0" points="5.00,6.00" z_order="0"/>
  </image>
  <image id="8" name="frame_000008" width="640" height="480">
    <tag label="slide" source="manual"><attribute name="speed">fast</attribute></tag>
  </image>
</annotations>
"""
LABEL_STUDIO = [
    {
        "id": 5,
        "data": {"video": "/data/upload/1/take.mp4"},
        "annotations": [
            {
                "id": 9,
                "completed_by": 1,
                "result": [
                    {
                        "id": "tJhYZLMC9G",
                        "type": "videorectangle",
                        "from_name": "box",
                        "to_name": "video",
                        "origin": "manual",
                        "value": {
                            "framesCount": 90,
                            "duration": 3.0,
                            "labels": ["cube"],
                            "sequence": [
                                {"frame": 2, "enabled": True, "rotation": 0, "x": 10, "y": 50, "width": 5, "height": 10,
                                 "time": 0.07},
                                {"frame": 10, "enabled": False, "rotation": 0, "x": 20, "y": 50, "width": 5,
                                 "height": 10, "time": 0.33},
                                {"frame": 13, "enabled": False, "rotation": 0, "x": 40, "y": 50, "width": 5,
                                 "height": 10, "time": 0.43},
                                {"frame": 16, "enabled": True, "rotation": 0, "x": 50, "y": 50, "width": 5,
                                 "height": 10, "time": 0.53},
                            ],
                        },
                    },
                    {
                        "id": "KtLcGzAxHv",
                        "type": "timelinelabels",
                        "from_name": "timelineLabels",
                        "to_name": "video",
                        "origin": "manual",
                        "value": {"ranges": [{"start": 3, "end": 5}], "timelinelabels": ["Moving"]},
                    },
                    {"from_id": "KtLcGzAxHv", "to_id": "tJhYZLMC9G", "type": "relation", "direction": "right",
                     "labels": ["theme"]},
                    {"id": "c", "type": "choices", "from_name": "c", "to_name": "video", "value": {"choices": ["x"]}},
                ],
            }
        ],
        "predictions": [],
    }
]  # fmt: skip
COCO = {
    "info": {},
    "videos": [{"id": 1, "name": "take"}],
    "images": [
        {"id": 11, "file_name": "take/000000.jpg", "width": 640, "height": 480, "video_id": 1, "frame_id": 0},
        {"id": 12, "file_name": "take/000001.jpg", "width": 640, "height": 480, "video_id": 1, "frame_id": 1},
        {"id": 13, "file_name": "take/000002.jpg", "width": 640, "height": 480, "video_id": 1, "frame_id": 2},
    ],
    "annotations": [
        {
            "id": 1,
            "image_id": 11,
            "category_id": 3,
            "instance_id": 7,
            "bbox": [1, 2, 3, 4],
            "area": 12,
            "iscrowd": 0,
        },
        {
            "id": 2,
            "image_id": 12,
            "category_id": 3,
            "instance_id": 7,
            "bbox": [2, 2, 3, 4],
            "area": 12,
            "iscrowd": 0,
        },
        {
            "id": 3,
            "image_id": 13,
            "category_id": 3,
            "segmentation": {"counts": "x", "size": [480, 640]},
            "iscrowd": 1,
        },
        {
            "id": 4,
            "image_id": 13,
            "category_id": 3,
            "segmentation": [[0, 0, 5, 0, 5, 5]],
            "bbox": [0, 0, 5, 5],
        },
    ],
    "categories": [{"id": 3, "name": "cube"}],
}
VIA = {
    "project": {"pid": "x", "rev": "1", "rev_timestamp": "1", "pname": "p", "creator": "VIA", "created": 1,
                "vid_list": ["1"]},
    "config": {"file": {"loc_prefix": {"1": "", "2": "", "3": "", "4": ""}}, "ui": {}},
    "attribute": {
        "1": {"aname": "Activity", "anchor_id": "FILE1_Z2_XY0", "type": 4, "desc": "Activity",
              "options": {"1": "Break Egg", "2": "Pour"}, "default_option_id": ""},
        "2": {"aname": "Object", "anchor_id": "FILE1_Z1_XY1", "type": 1, "desc": "", "options": {},
              "default_option_id": ""},
        "3": {"aname": "note", "anchor_id": "FILE1_Z2_XY0", "type": 1, "desc": "", "options": {},
              "default_option_id": ""},
    },
    "file": {"1": {"fid": 1, "fname": "take.mp4", "type": 4, "loc": 3, "src": "/home/ann/take.mp4"}},
    "view": {"1": {"fid_list": [1]}},
    "metadata": {
        "-glfwaaX": {"vid": "1", "flg": 0, "z": [1, 2.5], "xy": [], "av": {"1": "2", "3": "slowly"}},
        "fH-oMre1": {"vid": "1", "flg": 0, "z": [0.9], "xy": [2, 263, 184, 17, 13], "av": {"2": "Egg"}},
        "fH-oMre2": {"vid": "1", "flg": 0, "z": [0.9], "xy": [2, 1, 2, 3, 4], "av": {"2": "Egg"}},
        "fH-oMre3": {"vid": "1", "flg": 0, "z": [1.9], "xy": [3, 10, 10, 5], "av": {"2": "Egg"}},
        "fH-oMre4": {"vid": "1", "flg": 0, "z": [1.9], "xy": [6, 1, 1, 2, 2], "av": {"2": "way"}},
    },
}  # fmt: skip
VIDAT = {
    "version": "2.0.7",
    "annotation": {
        "video": {"src": "video/take.mp4", "fps": 10, "frames": 30, "duration": 3.0, "height": 480, "width": 640},
        "keyframeList": [0, 10, 20],
        "objectAnnotationListMap": {
            "0": [{"highlight": False, "instance": None, "score": None, "labelId": 1, "color": "#0000ff", "x": 1.5,
                   "y": 2, "width": 3, "height": 4}],
            "10": [{"highlight": False, "instance": None, "score": None, "labelId": 1, "color": "#0000ff", "x": 2.5,
                    "y": 2, "width": 3, "height": 4}],
        },
        "regionAnnotationListMap": {
            "0": [{"instance": 2, "score": None, "labelId": 1, "color": "#0000ff",
                   "pointList": [{"x": 0, "y": 0}, {"x": 4, "y": 0}, {"x": 4, "y": 3}]}],
        },
        "skeletonAnnotationListMap": {"0": [{"instance": None, "typeId": 0}]},
        "actionAnnotationList": [
            {"start": 0.5, "end": 1.5, "action": 1, "object": 1, "color": "#ffffff", "description": "to the left"}
        ],
    },
    "config": {
        "objectLabelData": [{"id": 0, "name": "default", "color": "#00ff00"},
                            {"id": 1, "name": "cube", "color": "#0000ff"}],
        "actionLabelData": [{"id": 0, "name": "default", "color": "#0000FF", "objects": [0]},
                            {"id": 1, "name": "slide", "color": "#0000FF", "objects": [1]}],
        "skeletonTypeData": [],
    },
}  # fmt: skip
BORIS = {
    "time_format": "hh:mm:ss",
    "project_name": "p",
    "project_format_version": "7.0",
    "subjects_conf": {"0": {"key": "1", "name": "Ann", "description": ""}},
    "behaviors_conf": {
        "0": {"type": "State event", "key": "S", "code": "slide", "category": "action", "modifiers": {
            "0": {"name": "what", "type": 0, "values": ["cube", "ball"]}}, "excluded": ""},
        "1": {"type": "Point event", "key": "T", "code": "tap", "category": "", "modifiers": ""},
    },
    "observations": {
        "take": {
            "file": {"1": ["/home/ann/take.mp4"], "2": []},
            "type": "MEDIA",
            "events": [
                [0.5, "Ann", "slide", "cube", "fast"],
                [0.7, "Ann", "slide", "ball", ""],
                [0.9, "", "tap", "", "", 27],
                [1.5, "Ann", "slide", "cube", ""],
                [2.0, "Ann", "slide", "ball", ""],
                [2.2, "No focal subject", "slide", "None", ""],
                ["NA", "", "tap", "", ""],
            ],
            "media_info": {"length": {"/home/ann/take.mp4": 3.0}, "fps": {"/home/ann/take.mp4": 30.0}},
        },
        "live": {"file": [], "type": "LIVE", "events": [[1.0, "", "tap", "", ""]]},
    },
}  # fmt: skip
EPIC = (
    "narration_id,participant_id,video_id,narration_timestamp,start_timestamp,stop_timestamp,start_frame,stop_frame,"
    "narration,verb,verb_class,noun,noun_class,all_nouns,all_noun_classes\n"
    "P01_01_0,P01,P01_01,00:00:01.089,00:00:00.14,00:00:03.37,8,202,open door,open,3,door,3,['door'],[3]\n"
    'P01_01_1,P01,P01_01,00:00:02.629,00:00:04.37,00:00:06.17,262,370,"put cup, spoon",put,1,cup,13,'
    "\"['cup', 'tea spoon']\",\"[13, 1]\"\n"
)
CSV = "type;start_s;end_s;hand\nslide;0.5;1.25;left\nslide;2;2.5;\n"


def written(folder: Path) -> dict[str, Path]:
    """All of them as files, by the name of the format."""
    texts = {
        "elan": ("a.eaf", EAF),
        "cvat-video": ("annotations.xml", CVAT),
        "label-studio": ("export.json", json.dumps(LABEL_STUDIO)),
        "coco": ("instances.json", json.dumps(COCO)),
        "via": ("via_project.json", json.dumps(VIA)),
        "vidat": ("annotations.json", json.dumps(VIDAT)),
        "boris": ("project.boris", json.dumps(BORIS)),
        "epic-kitchens": ("EPIC_100_train.csv", EPIC),
        "csv": ("events.csv", CSV),
    }
    found: dict[str, Path] = {}
    for name, (file, text) in texts.items():
        found[name] = folder / name / file
        found[name].parent.mkdir(parents=True, exist_ok=True)
        found[name].write_text(text, encoding="utf-8")
    return found
