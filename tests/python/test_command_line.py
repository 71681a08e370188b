"""Wrong commands and wrong files: the exit code is the published one, and the message says what is wrong."""

import pytest

import objlib

SPHERE = objlib.FIXTURES / "miniatures" / "closed_sphere.obj"


@pytest.mark.parametrize(
    "arguments",
    [
        ["simplify"],
        ["simplify", SPHERE, "--ratio", "0.5"],
        ["simplify", SPHERE, "-o", "OUT"],
        ["simplify", SPHERE, "-o", "OUT", "--ratio", "0.5", "--faces", "100"],
        ["simplify", SPHERE, "-o", "OUT", "--ratio", "much"],
        ["simplify", SPHERE, "-o", "OUT", "--ratio", "-0.1"],
        ["simplify", SPHERE, "-o", "OUT", "--ratio", "1.5"],
        ["simplify", SPHERE, "-o", "OUT", "--ratio", "nan"],
        ["simplify", SPHERE, "-o", "OUT", "--ratio", "0.5", "--memory", "some"],
        ["simplify", SPHERE, "-o", "OUT", "--ratio", "0.5", "--memory", "1MiB"],
        ["simplify", SPHERE, "-o", "OUT", "--ratio", "0.5", "--seams", "tear"],
        ["simplify", SPHERE, "-o", "OUT", "--ratio", "0.5", "--no-such-option"],
        ["simplify", SPHERE, "-o", "OUT", "--ratio", "0.5", "--atlas", "512"],
        ["simplify", SPHERE, "-o", "OUT", "--ratio", "0.5", "--seed", "4"],
        ["simplify", SPHERE, "-o", "OUT", "--ratio", "0.5", "--up", "y"],
        ["tile", SPHERE, "-o", "OUT", "--tasks", "5"],
        ["polish", SPHERE],
        [],
    ],
    ids=lambda arguments: "_".join(str(a).replace(str(SPHERE), "IN") for a in arguments) or "nothing",
)
def test_wrong_arguments_are_usage_errors(drystone, tmp_path, arguments):
    output = tmp_path / "out.obj"
    run = drystone(*(output if a == "OUT" else a for a in arguments), codes=(2,))
    assert run.stderr.strip(), "a usage error must say what is wrong"
    assert list(tmp_path.iterdir()) == [], "a usage error must leave nothing behind"


def test_missing_input_is_named(drystone, tmp_path):
    missing = tmp_path / "no_such_mesh.obj"
    run = drystone("simplify", missing, "-o", tmp_path / "out.obj", "--ratio", "0.5", codes=(1, 4))
    assert "no_such_mesh.obj" in run.stderr
    assert not (tmp_path / "out.obj").exists()


def test_bad_index_is_named_with_file_and_line(drystone, tmp_path):
    source = tmp_path / "bad.obj"
    source.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nf 1 2 99\n")
    run = drystone("simplify", source, "-o", tmp_path / "out.obj", "--ratio", "0.5", codes=(4,))
    assert "bad.obj:5" in run.stderr
    assert not (tmp_path / "out.obj").exists()


def test_existing_output_is_kept_unless_forced(drystone, tmp_path):
    output = tmp_path / "out.obj"
    output.write_text("precious")
    drystone("simplify", SPHERE, "-o", output, "--ratio", "0.5", codes=(2,))
    assert output.read_text() == "precious"
    drystone("simplify", SPHERE, "-o", output, "--ratio", "0.5", "--force")
    assert len(objlib.read(output).face) == 160


def test_work_folder_is_removed_unless_kept(drystone, tmp_path):
    work = tmp_path / "work"
    drystone.simplify(SPHERE, tmp_path, "--ratio", 0.5, "--work", work)
    assert not work.exists() or not any(work.iterdir())
    drystone.simplify(SPHERE, tmp_path, "--ratio", 0.5, "--work", work, "--keep-work", "--force")
    assert any(work.iterdir())


def test_nothing_but_the_result_is_left_beside_it(drystone, tmp_path):
    drystone.simplify(objlib.FIXTURES / "miniatures" / "seam_strip.obj", tmp_path, "--ratio", 0.5, codes=(0, 3))
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {"out.obj", "out.obj.json", "out.mtl", "out_textures"}


@pytest.mark.parametrize("handling", ["copy", "link", "reference"])
def test_texture_is_found_from_the_result(drystone, tmp_path, handling):
    source = objlib.FIXTURES / "miniatures" / "seam_strip.obj"
    run = drystone.simplify(source, tmp_path, "--ratio", 0.5, "--textures", handling, codes=(0, 3))
    original = (source.parent / "checker.png").read_bytes()
    names = objlib.textures(run.output)
    assert names and all((tmp_path / name).read_bytes() == original for name in names)


def test_help_and_version_go_to_stdout(drystone):
    assert "simplify" in drystone("--help").stdout
    assert "drystone" in drystone("--version").stdout
