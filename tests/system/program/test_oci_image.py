"""The chaincode service as an OCI image: a valid layout, and a program that starts with nothing but what is in it."""
import hashlib
import json
import os
import pathlib
import shutil
import signal
import subprocess

import pytest

ROOT = pathlib.Path(__file__).parents[3]
PROGRAM = "/usr/bin/ledgerline-chaincode"


@pytest.fixture(scope="module")
def image(tmp_path_factory) -> pathlib.Path:
    if not (shutil.which("umoci") and shutil.which("skopeo")):
        pytest.skip("umoci and skopeo are not here: ./run-tests installs them")
    folder = tmp_path_factory.mktemp("oci") / "image"
    subprocess.run([ROOT / "packaging/oci-image", folder], check=True, capture_output=True, timeout=120)
    return folder


@pytest.fixture(scope="module")
def tag(image) -> str:
    manifest, = json.loads((image / "index.json").read_text())["manifests"]
    return manifest["annotations"]["org.opencontainers.image.ref.name"]


@pytest.fixture(scope="module")
def inside(image, tag, tmp_path_factory) -> pathlib.Path:
    bundle = tmp_path_factory.mktemp("bundle") / "unpacked"
    subprocess.run(["umoci", "unpack", "--rootless", "--image", f"{image}:{tag}", bundle], check=True, capture_output=True, timeout=60)
    return bundle / "rootfs"


def test_the_layout_is_whole_and_nothing_else_is_in_it(image):
    assert json.loads((image / "oci-layout").read_text())["imageLayoutVersion"] == "1.0.0"
    blobs = {file.name: file.read_bytes() for file in (image / "blobs/sha256").iterdir()}
    assert all(hashlib.sha256(content).hexdigest() == name for name, content in blobs.items())
    named = lambda digest: digest.removeprefix("sha256:")
    index, = json.loads((image / "index.json").read_text())["manifests"]
    manifest = json.loads(blobs[named(index["digest"])])
    assert {named(index["digest"]), named(manifest["config"]["digest"])} | {named(layer["digest"]) for layer in manifest["layers"]} == set(blobs)


def test_the_image_says_how_it_is_started(image, tag):
    reported = subprocess.run(["skopeo", "inspect", "--config", f"oci:{image}:{tag}"], capture_output=True, text=True, check=True, timeout=60)
    config = json.loads(reported.stdout)["config"]
    assert config["Entrypoint"] == [PROGRAM] and config["User"] == "65532:65532" and list(config["ExposedPorts"]) == ["9999/tcp"]
    version = subprocess.run([f"{os.environ['LEDGERLINE_BIN']}/ledgerline-chaincode", "--version"], capture_output=True, text=True, check=True)
    assert version.stdout.split()[-1] == tag == config["Labels"]["org.opencontainers.image.version"]


def test_the_service_serves_with_what_is_in_the_image(inside):
    user = ["--userspec=65532:65532"] if owns_ids() else []
    process = subprocess.Popen(["/usr/sbin/chroot", *user, inside, PROGRAM],
                               env={"CHAINCODE_ID": "ledgerline_1:" + 64 * "0", "CHAINCODE_SERVER_ADDRESS": "127.0.0.1:0"}, stdout=subprocess.PIPE, text=True)
    try:
        assert json.loads(process.stdout.readline())["ready"]
    finally:
        process.send_signal(signal.SIGTERM)
    assert process.wait(timeout=20) == 0


def owns_ids() -> bool:
    """Whether other users can be become: not in a user namespace of one."""
    return int(pathlib.Path("/proc/self/uid_map").read_text().split()[2]) > 65532


def test_there_is_one_program_and_no_shell(inside):
    assert [path.name for path in (inside / "usr/bin").iterdir()] == ["ledgerline-chaincode"]
