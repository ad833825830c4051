"""Cameras: pictures on the bus, and robot poses from printed tags.

Frames: `camera` has X right, Y down and Z along the optical axis; `floor` has Z up and is the
`odom` of robots that follow this camera. Pixel centres have whole coordinates, as in OpenCV.
"""
