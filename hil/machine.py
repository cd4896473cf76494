"""The emulated machine: Debian's kernel and programs fetched by apt, packed as an initramfs, and
QEMU's command line. Everything fetched and built lies in build/hil/ARCHITECTURE."""
import dataclasses
import hashlib
import pathlib
import re
import shutil
import subprocess

import cpio

ROOT = pathlib.Path(__file__).resolve().parent.parent
WORK = ROOT / "build" / "hil"
PROGRAMS = ("systemd", "udev", "kmod", "iproute2", "can-utils", "coreutils", "dash",
            "busybox-static")
MODULES = ("can", "can_raw", "vcan", "kvaser_pci", "xhci_pci", "ftdi_sio", "virtio_pci",
           "virtio_net", "9p", "9pnet_virtio")
SHELL_TOOLS = ("kill", "mount", "sed", "umount")
LEFT_OUT = ("./usr/share/doc", "./usr/share/man", "./usr/share/locale", "./usr/lib/udev/hwdb.d",
            "./lib/udev/hwdb.d", "*/gconv")
# What a robot in memory can do without; udev looks only at what has a driver here (hil/network).
MASKED = tuple("""
    dev-hugepages.mount dev-mqueue.mount kmod-static-nodes.service ldconfig.service
    modprobe@configfs.service modprobe@dm_mod.service modprobe@fuse.service modprobe@loop.service
    proc-sys-fs-binfmt_misc.automount sys-kernel-debug.mount systemd-hwdb-update.service
    systemd-journal-catalog-update.service systemd-journal-flush.service
    systemd-modules-load.service systemd-random-seed.service systemd-remount-fs.service
    systemd-sysctl.service systemd-sysusers.service systemd-tmpfiles-clean.timer
    systemd-tmpfiles-setup.service systemd-tmpfiles-setup-dev.service
    systemd-udev-settle.service systemd-udev-trigger.service systemd-update-done.service
    systemd-update-utmp.service""".split())


@dataclasses.dataclass(frozen=True)
class Architecture:
    debian: str   # Debian's name
    preset: str   # of the robot binary's build
    console: str
    qemu: tuple   # program and machine


ARCHITECTURES = {
    "arm64": Architecture("arm64", "aarch64", "ttyAMA0",
                          ("qemu-system-aarch64", "-M", "virt", "-cpu", "cortex-a72")),
    "amd64": Architecture("amd64", "x86_64", "ttyS0",
                          ("qemu-system-x86_64", "-M", "q35", "-cpu", "max")),
}


def run(*command, **options):
    """Runs a command and returns what it wrote; raises with its messages when it fails."""
    done = subprocess.run([str(word) for word in command], text=True, stdout=subprocess.PIPE,
                          stderr=subprocess.STDOUT, **options)
    if done.returncode != 0:
        raise RuntimeError(f"{command[0]} failed:\n{done.stdout}")
    return done.stdout


def fetch(architecture):
    """Downloads the kernel's package and the programs' with all they depend on, by a private apt
    state; returns (kernel package, other packages)."""
    folder = WORK / architecture.debian / "apt"
    packages = folder / "cache" / "archives"
    kernels = folder / "kernel"
    complete = folder / "complete"
    if not complete.exists() or complete.read_text() != str(PROGRAMS):
        for path in (packages, kernels):
            shutil.rmtree(path, ignore_errors=True)
        for path in (folder / "lists" / "partial", packages / "partial", kernels):
            path.mkdir(parents=True, exist_ok=True)
        (folder / "status").touch()
        apt = ["-qq", "-o", f"Dir::State={folder}", "-o", f"Dir::State::Lists={folder}/lists",
               "-o", f"Dir::State::status={folder}/status", "-o", f"Dir::Cache={folder}/cache",
               "-o", f"APT::Architecture={architecture.debian}",
               "-o", f"APT::Architectures={architecture.debian}", "-o", "APT::Sandbox::User=root",
               "-o", "Acquire::Retries=3"]
        # A mirror in the middle of its own update lacks one list or another; the download decides.
        subprocess.run(["apt-get", *apt, "update"], check=False, capture_output=True)
        run("apt-get", *apt, "install", "--download-only", "--yes", "--no-install-recommends",
            *PROGRAMS)
        kernel = re.search(r"Depends: (linux-image-[0-9]\S+)",
                           run("apt-cache", *apt, "depends", f"linux-image-{architecture.debian}"))
        run("apt-get", *apt, "download", kernel.group(1), cwd=kernels)
        complete.write_text(str(PROGRAMS))
    return next(kernels.glob("*.deb")), sorted(packages.glob("*.deb"))


def unpack(package, folder, left_out=()):
    """Unpacks a Debian package; links of folders stay (bin -> usr/bin)."""
    with subprocess.Popen(["dpkg-deb", "--fsys-tarfile", package], stdout=subprocess.PIPE) as deb:
        run("tar", "-x", "--keep-directory-symlink", "-C", folder,
            *(f"--exclude={path}" for path in left_out), stdin=deb.stdout)


def install_modules(kernel, image):
    """Copies the modules named above, and those they need, into the image."""
    base = next((kernel / "lib" / "modules").iterdir())
    files = {path.stem.replace("-", "_"): path for path in base.rglob("*.ko")}
    wanted = list(MODULES)
    for name in wanted:
        if name not in files:
            continue  # part of this kernel
        path = files[name]
        copy = image / "usr/lib/modules" / base.name / path.relative_to(base)
        copy.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(path, copy)
        needs = run("/sbin/modinfo", "-F", "depends", path).strip()
        wanted += [need for need in needs.replace("-", "_").split(",")
                   if need and need not in wanted]
    for name in ("modules.order", "modules.builtin", "modules.builtin.modinfo"):
        shutil.copy(base / name, image / "usr/lib/modules" / base.name / name)
    run("/sbin/depmod", "-b", image, base.name)


def build_base(architecture):
    """Debian's part of the machine; returns (kernel image, initramfs), cached."""
    work = WORK / architecture.debian
    kernel_image, initramfs = work / "vmlinuz", work / "base.cpio"
    recipe = hashlib.sha256(pathlib.Path(__file__).read_bytes()).hexdigest()
    stamp = work / "recipe"
    if stamp.exists() and stamp.read_text() == recipe:
        return kernel_image, initramfs
    kernel_package, packages = fetch(architecture)
    for folder in ("image", "kernel"):
        shutil.rmtree(work / folder, ignore_errors=True)
    image, kernel = work / "image", work / "kernel"
    kernel.mkdir(parents=True)
    for name in ("bin", "sbin", "lib"):
        (image / "usr" / name).mkdir(parents=True)
        (image / name).symlink_to(f"usr/{name}")
    for name in ("proc", "sys", "dev", "run", "tmp", "root", "var/log"):
        (image / name).mkdir(parents=True)
    for package in packages:
        unpack(package, image, LEFT_OUT)
    for tool in SHELL_TOOLS:
        if not (image / "bin" / tool).exists():
            (image / "bin" / tool).symlink_to("busybox")
    for unit in MASKED:
        (image / "etc/systemd/system" / unit).symlink_to("/dev/null")
    (image / "init").symlink_to("usr/lib/systemd/systemd")
    unpack(kernel_package, kernel)
    install_modules(kernel, image)
    shutil.copy(next((kernel / "boot").glob("vmlinuz-*")), kernel_image)
    initramfs.write_bytes(cpio.archive(image))
    shutil.rmtree(kernel)
    shutil.rmtree(image)
    stamp.write_text(recipe)
    return kernel_image, initramfs


def command(architecture, folder):
    """QEMU for the machine whose files lie in `folder`. An instruction takes 1 ns of the machine's
    time, idling takes no real time: nothing depends on how fast the emulation runs."""
    return [*architecture.qemu, "-m", "512", "-icount", "shift=0,sleep=off",
            "-rtc", "base=2026-01-01,clock=vm", "-display", "none", "-nodefaults", "-no-reboot",
            "-serial", f"file:{folder}/console.log",
            "-monitor", f"unix:{folder}/monitor,server=on,wait=off",
            "-object", "can-bus,id=wire", "-device", "kvaser_pci,canbus=wire,addr=0x4",
            "-device", "kvaser_pci,canbus=wire,addr=0x5",
            "-object", f"memory-backend-file,id=exchange,size=1M,share=on,mem-path={folder}/exchange",
            "-device", "ivshmem-plain,memdev=exchange,addr=0x10",
            "-device", "qemu-xhci,addr=0x6", "-chardev", f"serial,id=lidar,path={folder}/lidar",
            "-device", "usb-serial,id=lidar,chardev=lidar",
            "-netdev", "user,id=radio", "-device",
            "virtio-net-pci,netdev=radio,addr=0x7,romfile=",
            "-virtfs", f"local,path={folder}/out,mount_tag=out,security_model=none",
            "-kernel", f"{WORK}/{architecture.debian}/vmlinuz", "-initrd", f"{folder}/initramfs",
            "-append", f"console={architecture.console} panic=-1 net.ifnames=0 quiet "
                       "systemd.unit=hil.target systemd.log_target=console"]
