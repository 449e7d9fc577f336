"""Names of scenes and the folders of their results: readable, on every system, no two alike."""

import random
import re

import pytest

from contimpact import InputError
from contimpact.results.scene import LONGEST_NAME, check_name, folder_of, require_own_folders

PLAIN = ["fig7", "Fig. 7, lower part", "50 % of r", "100%", "größer als 0.3", "a-b_c", "%zz", "x.y"]
AWKWARD = '/\\<>:"|?*%2Ff .aconul-é語'


@pytest.mark.parametrize("name", PLAIN)
def test_plain_names_are_folders_as_they_are(name):
    assert folder_of(check_name(name)) == name


@pytest.mark.parametrize(
    ("name", "folder"),
    [
        ("<script>alert(1)</script>", "%3Cscript%3Ealert(1)%3C%2Fscript%3E"),
        ("a/b\\c", "a%2Fb%5Cc"),
        (".", "%2E"),
        ("..", "%2E%2E"),
        (".hidden", "%2Ehidden"),
        ("../../etc", "%2E.%2F..%2Fetc"),
        ("s = 0.5 m: A?", "s = 0.5 m%3A A%3F"),
        ("end.", "end%2E"),
        ("a%2Fb", "a%252Fb"),
        ("CON", "%43ON"),
        ("nul.txt", "%6Eul.txt"),
        ("console", "console"),
        ("com1", "%63om1"),
    ],
)
def test_what_a_file_name_cannot_hold_is_escaped(name, folder):
    assert folder_of(check_name(name)) == folder


def test_no_two_names_have_one_folder_and_every_folder_is_a_file_name_everywhere():
    """Folders of up to `LONGEST_NAME` bytes give the name back by decoding what is escaped."""
    draw, known = random.Random(1), {}
    for _ in range(3000):
        name = "".join(draw.choices(AWKWARD, k=draw.randint(1, 12)))
        if not name.strip():
            continue
        folder = folder_of(check_name(name))
        assert known.setdefault(folder, name) == name
        decoded = re.sub(b"%([0-9A-F]{2})", lambda f: bytes.fromhex(f[1].decode()), folder.encode())
        assert decoded.decode() == name
        assert not set(folder) & set('/\\<>:"|?*')
        assert not folder.startswith(".")
        assert not folder.endswith((".", " "))


def test_long_names_are_cut_and_told_apart():
    names = ["/" * 150, "/" * 149 + "?", "語" * 60 + "/" * 20]
    folders = [folder_of(check_name(name)) for name in names]
    assert len(set(folders)) == len(names)
    assert all(len(folder.encode()) <= LONGEST_NAME for folder in folders)
    assert folders[2].startswith("語" * 60)


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (["a", "b", "a"], "two scenes are called 'a'"),
        (["Fig7", "fig7"], "'Fig7' and 'fig7' are one folder"),
        (["é", "e\u0301"], "are one folder"),
    ],
)
def test_names_with_one_folder_are_refused(names, said):
    with pytest.raises(InputError, match=said):
        require_own_folders(names)
    require_own_folders(["a/b", "a%2Fb", "a b", "a-b"])
