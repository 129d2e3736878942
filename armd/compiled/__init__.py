"""Functions compiled to machine code: ahead, into a library, or by numba when they are called."""
