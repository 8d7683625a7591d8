"""The published SOFA model's elements, kept to reproduce its results: co-rotational tetrahedra, springs."""
