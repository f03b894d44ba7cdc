"""What shells complete."""

import shutil
import subprocess

import pytest

from anm_mj.cli.main import COMMANDS, main

CASES = [
    ("", "", "explore"),
    ("", "exp", "explore export"),
    ("scene ", "", "import generate check list"),
    ("scene import a b --doors ", "", "as-is open closed"),
    ("explore home --st", "--st", "--start --steps"),
    ("doctor --", "--", "--report --json --quiet --verbose"),
    ("explore home ", "", ""),
    ("completion ", "f", "fish"),
]


def script(shell, capsys):
    assert main(["completion", shell]) == 0
    return capsys.readouterr().out


@pytest.mark.skipif(shutil.which("bash") is None, reason="there is no bash")
@pytest.mark.parametrize(("before", "word", "found"), CASES)
def test_bash_completes_commands_options_and_choices(before, word, found, capsys):
    words = [*before.removesuffix(word).split(), word]
    ask = (
        f"COMP_WORDS=(anm-mj {' '.join(repr(one) for one in words)}); COMP_CWORD={len(words)}\n"
        f'_anm_mj anm-mj "{word}"\necho "${{COMPREPLY[*]}}"'
    )
    done = subprocess.run(["bash", "-c", script("bash", capsys) + ask], capture_output=True, text=True, check=True)
    assert done.stderr == ""
    assert set(found.split()) <= set(done.stdout.split())
    assert found or not done.stdout.strip()


@pytest.mark.parametrize("shell", ["zsh", "fish"])
def test_other_shells_accept_what_is_printed(shell, capsys):
    text = script(shell, capsys)
    assert all(word in text for word in (*COMMANDS.commands, "keep-images", "as-is"))
    if shutil.which(shell) is None:
        pytest.skip(f"there is no {shell}")
    begin = "autoload -U compinit && compinit\n" if shell == "zsh" else ""
    done = subprocess.run([shell, "-c", begin + text], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
