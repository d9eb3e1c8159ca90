"""The jig's faces: their outlines, pixels that mix across their edges, and certified angles between them."""
