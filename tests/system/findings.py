"""What `ledgerline doctor --json` has found."""
import json
import subprocess


def of_doctor(done: subprocess.CompletedProcess) -> dict:
    """By problem. Exit code and `ok` agree."""
    said = json.loads(done.stdout)
    assert done.returncode == (0 if said["ok"] else 1), done.stderr
    return {check["problem"]: check for check in said["checks"] if check["problem"]}
