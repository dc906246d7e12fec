"""Recordings of cameras, read without their makers' programs: one module per format, all with the same few steps.

A reader finds out what there is (a track per stream, :mod:`ecat.formats.recordings.common`), and the session is
written from it in one go: colour as recorded where a browser plays it, depth without loss, every stream with its own
device times.
"""
