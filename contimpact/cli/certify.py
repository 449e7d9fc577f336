"""``contimpact certify``: prove what a catalogue says, by interval arithmetic."""

from __future__ import annotations

import argparse
import importlib.util
from pathlib import Path

from ..errors import InputError
from ..progress import telling
from ..results.catalogue import Results, open_results, scene_in
from ..results.options import CertifyOptions
from ..results.result_folder import hold_folder
from ..results.scene import load_scene
from ..segments.kernels import Kernels
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
    from . import parser, run

    scene = load_scene(options.target)
    enclosing_kernels(Kernels(scene.model, scene.parameter))  # refused before anything is run
    flags = [*(["-q"] if options.quiet else []), *(["--no-plot"] if options.no_plot else [])]
    given = parser().parse_args(["run", *flags, f"-o{options.output}", "--", options.target])
    return run.command(given)


def _certify_or_verify(folder: Path, options: argparse.Namespace) -> int:
    from ..certificates.certify import (
        FILE,
        ROWS,
        certify_results,
        verify_results,
        write_certificates,
    )

    with telling(folder.name, options.quiet) as tell:
        if options.verify:
            found = verify_results(open_results(folder), progress=tell)
        else:
            with hold_folder(folder, (FILE, ROWS)):
                results = open_results(folder)
                found = certify_results(results, settings_of(results), progress=tell, keep=True)
                write_certificates(results, found)
    if not options.quiet:
        for line in found.lines():
            say(line)
        done = "verified" if options.verify else f"written to {folder / FILE}"
        say(f"{done} in {found.seconds:.2f} s")
    if not found.certified:
        complain(f"{folder}: not everything is proven")
    return 0 if found.certified else 1


def settings_of(results: Results) -> CertifyOptions:
    """Return what the scene in a folder's manifest asks for; the defaults where there is none."""
    if results.manifest is None:
        return CertifyOptions()
    scene = scene_in(results.folder, manifest=results.manifest)
    return scene.certify or CertifyOptions(events=scene.events)
