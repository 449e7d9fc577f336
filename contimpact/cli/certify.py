"""``contimpact certify``: prove what a catalogue says, by interval arithmetic."""

from __future__ import annotations

import argparse
import importlib.util
from pathlib import Path

from ..errors import InputError
from ..results.options import CertifyOptions
from ..results.result_folder import MANIFEST, WANTED, hold_folder, read_json
from ..results.scene import load_scene, read_scene
from ..segments.kernels import Kernels
from ..telling import telling
from .terminal import complain, say


def command(options: argparse.Namespace) -> int:
    """Certify a folder, or a scene after running it; returns the exit status."""
    if importlib.util.find_spec("flint") is None:
        found = "python-flint, which proofs are made with, is not installed"
        raise InputError("certify", found, "pip install contimpact[certify]")
    target = Path(options.target)
    if target.is_dir():
        if options.output is not None:
            raise InputError("-o", "given with a folder", "its certificates are written into it")
        return _certify_or_verify(target, options)
    if options.verify:
        raise InputError(str(target), "no folder", "give the folder whose certificates to verify")
    return _run(options) or _certify_or_verify(Path(options.output), options)


def _run(options: argparse.Namespace) -> int:
    """Run the scene, as ``contimpact run`` does."""
    if options.output is None:
        raise InputError("-o", "missing", "give the folder to write to")
    from ..certificates.certify import enclosing_kernels
    from . import run

    scene = load_scene(options.target)
    enclosing_kernels(Kernels(scene.model, scene.parameter))  # refused before anything is run
    given = argparse.Namespace(
        scenes=[options.target],
        output=options.output,
        quiet=options.quiet,
        no_plot=options.no_plot,
        html=False,
        system=[],
    )
    return run.command(given)


def _certify_or_verify(folder: Path, options: argparse.Namespace) -> int:
    from ..certificates.certify import FILE, ROWS, certify_folder, verify_folder, write_certificates

    asked = settings_of(folder)
    with telling(folder.name, options.quiet) as tell:
        if options.verify:
            found = verify_folder(folder, progress=tell)
        else:
            with hold_folder(folder, (FILE, ROWS)):
                found = certify_folder(folder, asked, progress=tell, keep=True)
                write_certificates(folder, found)
    if not options.quiet:
        for line in found.lines():
            say(line)
        done = "verified" if options.verify else f"written to {folder / FILE}"
        say(f"{done} in {found.seconds:.2f} s")
    if not found.certified:
        complain(f"{folder}: not everything is proven")
    return 0 if found.certified else 1


def settings_of(folder: Path) -> CertifyOptions:
    """Return what the scene in a folder's manifest asks for; the defaults where there is none."""
    path = folder / "manifest.json"
    if not path.exists():
        return CertifyOptions()
    try:
        scene = read_scene(read_json(path, MANIFEST, WANTED)["scene"]["resolved"])
    except (KeyError, TypeError):
        raise InputError(str(path), "damaged: it holds no scene", f"give {WANTED}") from None
    return scene.certify or CertifyOptions(events=scene.events)
