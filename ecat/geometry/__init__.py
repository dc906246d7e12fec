"""Cameras, rigid transforms, planes and boxes: plain NumPy, right-handed, metres and radians."""
