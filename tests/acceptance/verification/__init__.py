"""Problems with known answers for the finite elements, used by ``softarm bench verify`` and the tests."""
