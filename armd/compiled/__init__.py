"""Functions compiled to machine code: in advance, into a library, or by numba when called."""
