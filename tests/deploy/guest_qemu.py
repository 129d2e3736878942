"""A whole PC in software: runs anywhere, has USB, and Python in it is twenty times slower."""

from __future__ import annotations

import gzip
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from debian_packages import CACHE, unpacked

WIRE = Path(__file__).with_name("guest_wire.py")
INIT = """\
#!/busybox sh
for module in /modules/*; do /busybox insmod $module; done
/busybox mount -t devtmpfs dev /dev
/busybox mount -t ext4 /dev/vda /root
/busybox mount -t devtmpfs dev /root/dev
exec /busybox switch_root /root /sbin/init
"""
#: Two FTDI adapters in a USB socket each: the arm's, whose bytes the guest itself carries to and
#: from a virtio port at the other end of guest_wire.py's; and one that is none of armd's business.
USB = """
    -device qemu-xhci,id=usb -device virtio-serial-pci
    -chardev socket,id=arm,fd={arm} -device virtserialport,chardev=arm,name=arm
    -chardev socket,id=adapter,fd={adapter}
    -device usb-serial,bus=usb.0,chardev=adapter,serial=SIM-0001,always-plugged=on
    -chardev null,id=none
    -device usb-serial,bus=usb.0,chardev=none,serial=OTHER,always-plugged=on
"""


class Qemu:
    """Debian's kernel under `qemu-system-x86_64 -accel tcg`."""

    stage_s = 2 * 3600.0

    def __init__(self) -> None:
        kernel = unpacked("linux-image-amd64")
        (self.image,) = kernel.glob("boot/vmlinuz-*")
        (self.modules,) = kernel.glob("lib/modules/*")
        self.initrd = CACHE / f"initrd-{self.modules.name}.gz"
        if not self.initrd.exists():
            _kmod("depmod", "-b", str(kernel), self.modules.name)
            self.initrd.write_bytes(self._initrd(kernel))

    def command(self, disks: Sequence[Path], words: str) -> list[str]:
        tools = unpacked("qemu-system-x86")
        # Its libraries and firmware lie where they were unpacked, not where it was built to look.
        libraries = ":".join(str(path) for path in tools.glob("**/*-linux-gnu"))
        drives = [["-drive", f"file={disk},format=raw,if=virtio"] for disk in disks]
        return [
            *(sys.executable, str(WIRE), "env", f"LD_LIBRARY_PATH={libraries}"),
            str(tools / "usr/bin/qemu-system-x86_64"),
            *("-L", str(tools / "usr/share/qemu"), "-L", str(tools / "usr/share/seabios")),
            *("-accel", "tcg", "-cpu", "max", "-smp", "2", "-m", "3G", "-nodefaults"),
            *("-nographic", "-no-reboot", "-serial", "stdio"),
            *USB.split(),
            *(word for drive in drives for word in drive),
            *("-kernel", str(self.image), "-initrd", str(self.initrd)),
            *("-append", f"console=ttyS0 {words}"),
        ]

    def disk(self, number: int) -> str:
        return f"/dev/vd{'abc'[number]}"

    def _initrd(self, kernel: Path) -> bytes:
        """Just enough to load the disk's drivers and go over to it."""
        root = CACHE / "initrd"
        shutil.rmtree(root, ignore_errors=True)
        for folder in ("dev", "root", "modules"):
            (root / folder).mkdir(parents=True)
        shutil.copy(unpacked("busybox-static") / "bin/busybox", root / "busybox")
        needed: dict[str, None] = {}
        for name in ("virtio_pci", "virtio_blk", "ext4", "crc32c_generic"):
            listed = _kmod("modprobe", "-d", str(kernel), "-S", self.modules.name, "-D", name)
            lines = [line.split() for line in listed.splitlines()]
            needed |= dict.fromkeys(path for kind, path, *_ in lines if kind == "insmod")
        for number, path in enumerate(needed):  # in the order in which they need each other
            shutil.copy(path, root / "modules" / f"{number:02}.ko")
        (root / "init").write_text(INIT)
        (root / "init").chmod(0o755)
        names = "\n".join(str(path.relative_to(root)) for path in sorted(root.rglob("*")))
        cpio = [str(unpacked("cpio") / "bin/cpio"), "-o", "-H", "newc", "--quiet"]
        packed = subprocess.run(
            cpio, input=names.encode(), cwd=root, check=True, capture_output=True
        )
        shutil.rmtree(root)
        return gzip.compress(packed.stdout)


def _kmod(*command: str) -> str:
    """kmod is many tools in one, told apart by the name it is called with."""
    tool = unpacked("kmod") / "bin/kmod"
    return subprocess.run(
        command, executable=tool, check=True, capture_output=True, text=True
    ).stdout
