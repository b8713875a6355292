"""Where robots may be: rectangles with boxes, and sites with polygons; distances in them, and the files they are in."""
