"""Sparse linear algebra on 3 x 3 blocks: ordering, symbolic analysis, Cholesky factor, SIMD vectors."""
