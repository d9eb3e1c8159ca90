"""A reader for each file format of a scan: from the file's bytes to points and, where it has them, normals.

The readers are this project's own, and small, because of damaged files: other libraries return a part of one, fill it
up with zeros, print, or end the process. The tests compare whole files with what those libraries read and write. Only
.e57, a container with its own compression and checksums, is left to the library that the trade shares.
"""
