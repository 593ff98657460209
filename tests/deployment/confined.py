"""Run a Python module as the unit's service is run: its limits, no capability, its system calls.

python confined.py MODULE ARGUMENT…, with the allowed calls on standard input. The filter is made
with libseccomp, as systemd makes it: what is not allowed fails with EPERM. Where this process may
not raise its limits, as in a container, it keeps the two capabilities that stand for them.
"""

import ctypes
import errno
import resource
import runpy
import sys

ALLOW = 0x7FFF0000
FAIL = 0x00050000 | errno.EPERM
IPC_LOCK, SYS_NICE = 1 << 14, 1 << 23
NO_NEW_PRIVILEGES, CAPABILITIES_VERSION, NO_EXECUTABLE_WRITES = 38, 0x20080522, 65


def raised(priority):
    """Set the unit's limits; whether this process may."""
    try:
        resource.setrlimit(resource.RLIMIT_RTPRIO, (priority, priority))
        resource.setrlimit(resource.RLIMIT_MEMLOCK, (resource.RLIM_INFINITY,) * 2)
    except ValueError:
        return False
    return True


def confine(calls, priority):
    """Take what the unit takes from this process and from those that it starts."""
    kept = 0 if raised(priority) else IPC_LOCK | SYS_NICE
    libc, seccomp = ctypes.CDLL(None, use_errno=True), ctypes.CDLL("libseccomp.so.2")
    assert libc.prctl(NO_NEW_PRIVILEGES, 1, 0, 0, 0) == 0
    libc.prctl(NO_EXECUTABLE_WRITES, 1, 0, 0, 0)  # from Linux 6.3 on
    header = (ctypes.c_uint32 * 2)(CAPABILITIES_VERSION, 0)
    assert libc.capset(header, (ctypes.c_uint32 * 6)(kept, kept)) == 0
    seccomp.seccomp_init.restype = ctypes.c_void_p
    made = ctypes.c_void_p(seccomp.seccomp_init(FAIL))
    for name in calls:
        number = seccomp.seccomp_syscall_resolve_name(name.encode())
        if number >= 0:  # those of other processors have none
            assert seccomp.seccomp_rule_add(made, ALLOW, number, 0) == 0
    assert seccomp.seccomp_load(made) == 0


if __name__ == "__main__":
    confine(sys.stdin.read().split(), 90)
    with open("/dev/null") as nothing:
        sys.stdin = nothing
        sys.argv = sys.argv[1:]
        runpy.run_module(sys.argv[0], run_name="__main__", alter_sys=True)
