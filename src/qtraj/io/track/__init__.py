"""Layer 6: recordings of the motion of a vehicle, in files of any kind and in tables of other libraries."""
