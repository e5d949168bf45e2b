float stripes (float x, float n) { return mod (floor (x * n), 2); }
