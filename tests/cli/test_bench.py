"""What keeps the benchmarks from running."""

from tests.cli.command import invoke


def test_a_missing_store_is_said() -> None:
    done = invoke("bench", BREAKAWAY_MODEL_STORE="nowhere")
    assert done.exit_code == 1
    assert done.stderr == "the model store nowhere is not a directory\n"
