"""Real compilers and drivers for the exported code.

One that misses skips the test and says how to install it; with WARPOPT_TOOLS=required, which `.ci/run` sets where it
could install them, it fails the test.
"""

import importlib
import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from warpopt.export.languages import GLSL_330, GLSL_450, HLSL, Language

_FLAGS = ["-Wall", "-Wextra", "-Werror", "-pedantic", "-fsanitize=address,undefined", "-fno-sanitize-recover=all"]
_MAIN = """#include "code{suffix}"
#include <stdio.h>
int main(void) {{
    float given[4];
    while (fread(given, sizeof given, 1, stdin) == 1) {{
        float theta = given[0], near = given[1], far = given[2], half_fov = given[3];
        float found[2] = {{{eta}, {lam}}};
        (void)half_fov;
        if (fwrite(found, sizeof found, 1, stdout) != 1) return 1;
    }}
    return 0;
}}
"""


def missing(words: str) -> None:
    """Skip the test, or fail it where the tools must be there."""
    (pytest.fail if os.environ.get("WARPOPT_TOOLS") == "required" else pytest.skip)(words)


def package(name: str):
    """A package of the `test` extra."""
    try:
        return importlib.import_module(name)
    except ImportError:
        missing(f"{name} is not installed: pip install 'warpopt[test]'")


def calls(closed: bool) -> dict[str, str]:
    arguments = "theta, near, far, half_fov" if closed else "theta, near, far"
    return {"eta": f"warpopt_eta({arguments})", "lam": f"warpopt_lambda({arguments})"}


def run_compiled(compiler: str, suffix: str, text: str, given: np.ndarray, closed: bool, folder: Path) -> np.ndarray:
    """(eta, lambda) of each row (theta, near, far, half_fov), by gcc or g++ under the sanitisers."""
    return run_program(compiler, suffix, text, _MAIN.format(suffix=suffix, **calls(closed)), given, 2, folder)


def run_program(
    compiler: str, suffix: str, text: str, main: str, given: np.ndarray, outputs: int, folder: Path
) -> np.ndarray:
    """So many numbers for each row, by a program that includes the text, reads rows and writes numbers, in singles."""
    if shutil.which(compiler) is None:
        missing(f"{compiler} is not on this machine: apt-get install {compiler}")
    (folder / f"code{suffix}").write_text(text)
    c = suffix == ".h"
    source = folder / f"main{'.c' if c else '.cpp'}"
    source.write_text(main)
    standard = "-std=c99" if c else "-std=c++17"
    program = folder / "main"
    subprocess.run([compiler, standard, "-O1", *_FLAGS, "-o", str(program), str(source), "-lm"], check=True)
    run = subprocess.run([str(program)], input=np.float32(given).tobytes(), capture_output=True, check=True)
    return np.frombuffer(run.stdout, np.float32).reshape(-1, outputs)


SHADERS = pytest.mark.parametrize(
    ("language", "words"),
    [(GLSL_330, ["-S", "vert"]), (GLSL_450, ["-S", "vert"]), (HLSL, ["-D", "-S", "vert", "-e", "main", "-V"])],
    ids=["330", "450", "hlsl"],
)


def validate_call(language: Language, words: list[str], text: str, call: str, folder: Path) -> None:
    """The verdict on a vertex shader that uses a call of the text's."""
    if language is HLSL:
        text += f"\nfloat4 main(float4 p : POSITION) : SV_Position {{ return p * {call}; }}\n"
    else:
        version = "330" if language is GLSL_330 else "450"
        text = f"#version {version}\n{text}\nvoid main() {{ gl_Position = vec4({call}); }}\n"
    validate(words, text, folder / "code.vert")


def validate(words: list[str], text: str, file: Path) -> None:
    """glslang's verdict.

    Raises:
        AssertionError: with its words, if it refuses.
    """
    tool = shutil.which("glslangValidator") or shutil.which("glslang")
    if tool is None:
        missing("glslangValidator is not on this machine: apt-get install glslang-tools")
    file.write_text(text)
    # It writes what it compiles into its working directory.
    result = subprocess.run([tool, *words, str(file)], capture_output=True, text=True, cwd=file.parent)
    assert result.returncode == 0, result.stdout + result.stderr


def run_glsl(version: int, text: str, given: np.ndarray, closed: bool) -> np.ndarray:
    """(eta, lambda) of each row, by a vertex shader of OpenGL through EGL, kept by transform feedback."""
    moderngl = package("moderngl")
    try:
        context = moderngl.create_context(standalone=True, backend="egl", require=version)
    except Exception as flaw:  # what it raises depends on what is missing
        words = str(flaw).splitlines()[0]
        missing(f"no OpenGL {version} through EGL ({words}): apt-get install libegl1 libgl1 libgl1-mesa-dri")
    with context:
        shader = f"""#version {version}
{text}
in vec4 given;
out vec2 found;
void main() {{
    float theta = given.x, near = given.y, far = given.z, half_fov = given.w;
    found = vec2({calls(closed)["eta"]}, {calls(closed)["lam"]});
    gl_Position = vec4(0.0);
}}
"""
        context.simple_framebuffer((1, 1)).use()  # surfaceless EGL has none of its own
        program = context.program(vertex_shader=shader, varyings=["found"])
        points = context.buffer(given.astype(np.float32).tobytes())
        results = context.buffer(reserve=8 * len(given))
        context.vertex_array(program, [(points, "4f", "given")]).transform(results, moderngl.POINTS, len(given))
        return np.frombuffer(results.read(), np.float32).reshape(-1, 2)


def run_wgsl(text: str, given: np.ndarray, closed: bool) -> np.ndarray:
    """(eta, lambda) of each row, by a compute shader of WebGPU (wgpu-native, whose compiler is naga)."""
    wgpu = package("wgpu")
    try:
        adapter = wgpu.gpu.request_adapter_sync(power_preference="low-power")
        device = adapter.request_device_sync()
    except Exception as flaw:
        words = str(flaw).splitlines()[0]
        missing(f"no WebGPU adapter ({words}): apt-get install libvulkan1 mesa-vulkan-drivers")
    shader = f"""{text}
@group(0) @binding(0) var<storage, read> given: array<vec4<f32>>;
@group(0) @binding(1) var<storage, read_write> found: array<vec2<f32>>;
@compute @workgroup_size(64)
fn main(@builtin(global_invocation_id) id: vec3<u32>) {{
    if (id.x >= arrayLength(&given)) {{ return; }}
    let theta = given[id.x].x;
    let near = given[id.x].y;
    let far = given[id.x].z;
    let half_fov = given[id.x].w;
    found[id.x] = vec2<f32>({calls(closed)["eta"]}, {calls(closed)["lam"]});
}}
"""
    usage = wgpu.BufferUsage
    module = device.create_shader_module(code=shader)
    pipeline = device.create_compute_pipeline(layout="auto", compute={"module": module, "entry_point": "main"})
    points = device.create_buffer_with_data(data=given.astype(np.float32).tobytes(), usage=usage.STORAGE)
    results = device.create_buffer(size=8 * len(given), usage=usage.STORAGE | usage.COPY_SRC)
    entries = [{"binding": k, "resource": {"buffer": b}} for k, b in enumerate((points, results))]
    group = device.create_bind_group(layout=pipeline.get_bind_group_layout(0), entries=entries)
    encoder = device.create_command_encoder()
    work = encoder.begin_compute_pass()
    work.set_pipeline(pipeline)
    work.set_bind_group(0, group)
    work.dispatch_workgroups(-(-len(given) // 64))
    work.end()
    device.queue.submit([encoder.finish()])
    return np.frombuffer(device.queue.read_buffer(results), np.float32).reshape(-1, 2)
