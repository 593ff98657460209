"""C exports on simulated Cortex-M boards, and here with every check that compilers have."""

import re
import subprocess
from pathlib import Path

import needs
import pytest

from benchmarks.microcontroller.boards import BOARDS, CORTEX_M4F, self_tested, taken
from benchmarks.microcontroller.cycles import _cycles, _registers, cycles_of_a_step
from export.c.packaging import Wish, export_c
from runtime.compiled.folder import CFolder, read_c_folder
from trainers.build import ARCHITECTURES

SANITIZED = ("-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")


@pytest.fixture(scope="module")
def c_of(exported_arch, tmp_path_factory):
    """A folder of C of an architecture's package, made once."""
    made: dict[tuple[str, str], CFolder] = {}

    def make(arch: str, kind: str = "float32") -> CFolder:
        if (arch, kind) not in made:
            folder = tmp_path_factory.mktemp("c") / "c"
            wish = Wish(kind, tolerance=1.0)
            made[arch, kind] = export_c(exported_arch(arch).package, folder, wish)
        return made[arch, kind]

    return make


@pytest.mark.slow
@needs.arm
@pytest.mark.parametrize("board", BOARDS, ids=lambda board: board.name)
@pytest.mark.parametrize("arch", ARCHITECTURES)
def test_each_architecture_tells_the_same_on_each_board(c_of, arch, board):
    folder = c_of(arch)
    assert self_tested(folder, board) <= folder.document.limit


@pytest.mark.slow
@needs.arm
@pytest.mark.parametrize("kind", ["float16", "int8"])
def test_rounded_weights_tell_the_same_on_a_board(c_of, kind):
    folder = c_of("gru", kind)
    assert self_tested(folder, CORTEX_M4F) <= folder.document.limit


@pytest.mark.slow
@needs.arm
def test_a_gru_of_71000_weights_takes_3_ms_and_8_kb(c_of):
    folder = c_of("gru")
    found = taken(folder, CORTEX_M4F)
    executed, cycles = cycles_of_a_step(folder)
    assert abs(executed / found.instructions - 1.0) < 0.01, "two ways to count agree"
    assert cycles / 168e6 <= 3e-3
    assert found.ram <= 8192
    assert found.static_ram == 0
    assert folder.document.stack_bytes < found.stack < folder.document.stack_bytes + 512
    assert 0 < found.flash - folder.document.weight_bytes < 6000, "code beside the weights"


@pytest.mark.slow
@needs.c_compiler
@pytest.mark.parametrize(
    ("arch", "kind"),
    [*((arch, "float32") for arch in ARCHITECTURES), ("gru", "int8"), ("esn", "int8")],
)
def test_sanitizers_find_nothing_over_the_rollout(c_of, arch, kind, tmp_path):
    folder, program = c_of(arch, kind), tmp_path / "self-test"
    sources = [folder.source, folder.test]
    subprocess.run(["gcc", *SANITIZED, *sources, "-o", program, "-lm"], check=True)
    done = subprocess.run([program], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")


def test_cycles_are_those_of_the_manual():
    assert _cycles("vldr", "s0, [r1]") == 2
    assert _cycles("vfma.f32", "s0, s1, s2") == 3
    assert _cycles("vmul.f32", "s0, s1, s2") == 1
    assert _cycles("vldmia", "r1!, {s15}") == 2
    assert _cycles("push", "{r4, r5, lr}") == 4
    assert _cycles("vdiv.f32", "s0, s1, s2") == 14
    assert _cycles("bne.n", "86") == 3
    assert _registers("sp!, {r4-r7, lr}") == 5
    assert _registers("sp!, {d8-d9}") == 2


@needs.arm
def test_a_source_compiles_for_a_cortex_m_without_a_warning(exported_arch, tmp_path):
    from c_steps import model_of, written

    path = written(model_of(exported_arch("mamba").package), tmp_path)
    flags = [
        "-O2",
        "-std=c99",
        "-Wall",
        "-Wextra",
        "-Wconversion",
        "-Wdouble-promotion",
        "-Werror",
        "-fstack-usage",
    ]
    out = tmp_path / "model.o"
    subprocess.run(
        ["arm-none-eabi-gcc", *CORTEX_M4F.flags, *flags, "-c", path, "-o", out], check=True
    )
    undefined = subprocess.run(
        ["arm-none-eabi-nm", "-u", out], capture_output=True, text=True, check=True
    ).stdout
    called = set(re.findall(r"U (\w+)", undefined)) - {"memset", "memcpy"}
    assert called <= {"expf", "tanhf", "log1pf", "sqrtf"}, "nothing but <math.h>"
    usage = Path(str(out).removesuffix(".o") + ".su").read_text()
    assert "dynamic" not in usage, "no arrays of unknown length on the stack"


@needs.c_compiler
def test_no_memory_is_reserved_but_constants(c_of, tmp_path):
    folder = c_of("agile-mlp")
    out = tmp_path / "model.o"
    subprocess.run(["gcc", "-O2", "-c", folder.source, "-o", out], check=True)
    told = subprocess.run(["size", out], capture_output=True, text=True, check=True).stdout
    _, data, bss = told.splitlines()[1].split()[:3]
    assert (int(data), int(bss)) == (0, 0)
    assert read_c_folder(folder.path).document == folder.document
