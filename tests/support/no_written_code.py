"""A program under which memory that was written is never executed, as under systemd's
MemoryDenyWriteExecute: `python -m support.no_written_code COMMAND …`.

systemd's filter of system calls (`seccomp_memory_deny_write_execute` in its `seccomp-util.c`):
mmap with PROT_WRITE and PROT_EXEC, mprotect with PROT_EXEC, shmat with SHM_EXEC are refused; and,
as systemd has done since 254, the kernel's own rule, PR_SET_MDWE, where the kernel has it.
"""

from __future__ import annotations

import ctypes
import os
import platform
import struct
import sys

PR_SET_NO_NEW_PRIVS, PR_SET_SECCOMP, PR_SET_MDWE = 38, 22, 65
SECCOMP_MODE_FILTER, REFUSE_EXEC_GAIN = 2, 1
#: mmap, mprotect, pkey_mprotect, shmat
CALLS = {"x86_64": (9, 10, 329, 30), "aarch64": (222, 226, 288, 196)}
FORBIDDEN = (0x2 | 0x4, 0x4, 0x4, 0o100000)  # what of their third argument, together
#: Of the kernel's packet filter language: load a word, jump if equal, and, return.
LOAD, EQUAL, AND, RETURN = 0x20, 0x15, 0x54, 0x06
THIRD_ARGUMENT = 16 + 2 * 8  # its low half, in struct seccomp_data
REFUSED, ALLOWED = 0x00050000 | 1, 0x7FFF0000  # EPERM


def forbid() -> None:
    """For this process and all it becomes. Raises `OSError` where the kernel cannot."""
    libc = ctypes.CDLL(None, use_errno=True)
    program = [(LOAD, 0, 0, 0)]
    for call, mask in zip(CALLS[platform.machine()], FORBIDDEN, strict=True):
        program += [
            (EQUAL, 0, 4, call),
            (LOAD, 0, 0, THIRD_ARGUMENT),
            (AND, 0, 0, mask),
            (EQUAL, 0, 1, mask),
            (RETURN, 0, 0, REFUSED),
            (LOAD, 0, 0, 0),
        ]
    program.append((RETURN, 0, 0, ALLOWED))
    code = ctypes.create_string_buffer(b"".join(struct.pack("HBBI", *line) for line in program))
    filter_ = struct.pack("@HP", len(program), ctypes.addressof(code))
    if libc.prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) != 0:
        raise OSError(ctypes.get_errno(), "PR_SET_NO_NEW_PRIVS")
    if libc.prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, filter_, 0, 0) != 0:
        raise OSError(ctypes.get_errno(), "PR_SET_SECCOMP")
    libc.prctl(PR_SET_MDWE, REFUSE_EXEC_GAIN, 0, 0, 0)  # since Linux 6.3


if __name__ == "__main__":
    forbid()
    os.execvp(sys.argv[1], sys.argv[1:])
