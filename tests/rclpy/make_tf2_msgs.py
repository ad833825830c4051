"""Build the Python package tf2_msgs, for which no wheel exists, like ROS's own build.

Runs the rosidl generators on the definition of `TFMessage`, and a C compiler on their output. The
library is installed next to the other packages of this environment.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path

import numpy
from rosidl_adapter.msg import convert_msg_to_idl
from rosidl_generator_c.cli import GenerateC
from rosidl_generator_py.cli import GeneratePython
from rosidl_generator_type_description.cli import HashTypeDescription
from rosidl_typesupport_c.cli import GenerateCTypesupport
from rosidl_typesupport_fastrtps_c.cli import GenerateFastRTPSCTypesupport
from rosidl_typesupport_introspection_c.cli import GenerateIntrospectionCTypesupport

PACKAGE = "tf2_msgs"
DEFINITION = "geometry_msgs/TransformStamped[] transforms\n"
DISPATCH = "rosidl_typesupport_c"
FAST_DDS = "rosidl_typesupport_fastrtps_c"
INTROSPECTION = "rosidl_typesupport_introspection_c"
LIBRARIES = (
    "geometry_msgs__rosidl_generator_c",
    "geometry_msgs__rosidl_generator_py",
    f"geometry_msgs__{FAST_DDS}",
    f"geometry_msgs__{INTROSPECTION}",
    "rosidl_runtime_c",
    DISPATCH,
    FAST_DDS,
    INTROSPECTION,
    "fastcdr",
    "rcutils",
    "rmw",
)


def generate(folder: Path, prefix: Path) -> Path:
    """Write the sources of the package, and return the folder of its Python modules."""
    out = folder / "c" / PACKAGE
    (out / "msg").mkdir(parents=True)
    (out / "__init__.py").touch()
    (out / "msg" / "TFMessage.msg").write_text(DEFINITION, encoding="utf-8")
    convert_msg_to_idl(out, PACKAGE, Path("msg/TFMessage.msg"), out / "msg")
    what = (PACKAGE, [f"{out}:msg/TFMessage.idl"], [str(prefix / "share")])
    hashes = HashTypeDescription("type_description").generate_type_hashes(*what, out)
    GenerateC("c").generate(*what, out, type_description_files=hashes)
    GenerateFastRTPSCTypesupport(FAST_DDS).generate(*what, out)
    # Some of its files have the same names.
    GenerateIntrospectionCTypesupport(INTROSPECTION).generate(
        *what, folder / "introspection" / PACKAGE
    )
    both = [FAST_DDS, INTROSPECTION]
    GenerateCTypesupport(DISPATCH, typesupport_implementations=both).generate(*what, out)
    GeneratePython("py", typesupport_implementations=[DISPATCH]).generate(*what, out)
    return out


def build(folder: Path, prefix: Path, library: Path) -> None:
    """Compile all sources into one library."""
    sources = [each for kind in ("c", "cpp") for each in folder.rglob(f"*.{kind}")]
    headers = prefix / "include"  # Per-package folders, except for Fast DDS.
    include: list[Path | str] = [folder / "c", folder / "introspection", headers]
    include += [*headers.iterdir(), numpy.get_include(), sysconfig.get_path("include")]
    subprocess.run(
        [
            *("gcc", "-shared", "-fPIC", "-O1"),
            *(f"-I{each}" for each in include),
            *map(str, sources),
            *(f"-L{prefix / 'lib'}", f"-Wl,-rpath,{prefix / 'lib'}"),
            *(f"-l{each}" for each in LIBRARIES),
            *("-lstdc++", "-o", str(library)),
        ],
        check=True,
    )


def main() -> None:
    """Build the package in this environment."""
    if shutil.which("g++") is None:
        sys.exit("the tests with ROS 2 need a C++ compiler: sudo apt-get install g++")
    prefix = Path(sys.prefix)
    os.environ["AMENT_PREFIX_PATH"] = str(prefix)
    with tempfile.TemporaryDirectory() as name:
        out = generate(Path(name), prefix)
        module = out / f"{PACKAGE}_s__{DISPATCH}.so"
        build(Path(name), prefix, module)
        installed = Path(sysconfig.get_path("purelib")) / PACKAGE
        shutil.rmtree(installed, ignore_errors=True)
        shutil.copytree(out, installed)
    for each in (FAST_DDS, INTROSPECTION):  # These names are searched.
        link = prefix / "lib" / f"lib{PACKAGE}__{each}.so"
        link.unlink(missing_ok=True)
        link.symlink_to(installed / module.name)


if __name__ == "__main__":
    main()
