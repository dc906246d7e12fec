"""Formats of robots, viewers and animators: what was seen in space and when, written for others.

Each module says in its first lines what its format carries and what has to stay behind; what stays behind of a session
is named by the export.
"""
