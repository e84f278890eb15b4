"""What bash completes of `ledgerline`, by the script that it prints and by the one that is installed."""
import shutil
import subprocess

import pytest
from programs import BIN

LEDGERLINE = BIN / "ledgerline"
COMPLETE = """
COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); COMP_LINE="$*"; COMP_POINT=${#COMP_LINE}
rule=$(complete -p ledgerline)
function=${rule#*-F }; ${function%% *}
printf '%s\\n' "${COMPREPLY[@]}"
"""


def completed(script: str, *words: str) -> set[str]:
    shown = subprocess.run(["bash", "-euc", script + COMPLETE, "bash", LEDGERLINE, *words], capture_output=True, text=True, check=True, timeout=60)
    return set(shown.stdout.split())


@pytest.fixture(scope="module")
def script() -> str:
    return subprocess.run([LEDGERLINE, "completion", "bash"], capture_output=True, text=True, check=True, timeout=60).stdout


def test_bash_completes_verbs_their_verbs_and_their_options(script):
    assert {"fly", "control", "completion"} <= completed(script, "")
    assert completed(script, "contro") == {"control"}
    assert completed(script, "fly", "--dro") == {"--drones"}
    assert completed(script, "control", "sto") == {"stop"}
    assert completed(script, "drones", "hand") == {"hand_over"}
    assert completed(script, "drones", "stop", "tello1", "--a") == {"--all"}
    assert completed(script, "drones", "stop", "--j") == {"--json"}
    assert completed(script, "completion", "") == {"bash", "zsh"}
    assert completed(script, "no-such-verb", "--") == set()


def test_an_options_value_is_left_to_the_shell(script):
    assert completed(script, "control", "--config", "st") == set()


@pytest.mark.skipif(not shutil.which("zsh"), reason="there is no zsh here")
def test_zsh_takes_its_script():
    subprocess.run(["zsh", "-fc", 'autoload -U compinit; compinit -D; eval "$(' + str(LEDGERLINE) + ' completion zsh)"; (( $+functions[_ledgerline] ))'],
                   check=True, timeout=60)


def test_what_is_no_shell_is_bad_usage():
    for words in ([], ["fish"], ["bash", "zsh"]):
        assert subprocess.run([LEDGERLINE, "completion", *words], capture_output=True, timeout=60).returncode == 2


def test_the_scripts_are_installed_as_they_are_printed(tmp_path):
    subprocess.run(["cmake", "--install", BIN.parent, "--component", "common", "--prefix", tmp_path], check=True, capture_output=True)
    for shell, place in (("bash", "bash-completion/completions/ledgerline"), ("zsh", "zsh/site-functions/_ledgerline")):
        printed = subprocess.run([LEDGERLINE, "completion", shell], capture_output=True, text=True, check=True, timeout=60).stdout
        assert (tmp_path / "share" / place).read_text() == printed
