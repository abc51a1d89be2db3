"""The designs that come with the packaged vehicles: all of them, made again and proved.

python -m rotordx.gains.packaged

A file is written only if something in it has changed by more than solvers differ from processor to processor.
"""

from __future__ import annotations

import json
from importlib import import_module, resources
from pathlib import Path
from time import perf_counter

from rotordx.fmus.vehicles import load_vehicle, vehicle_names
from rotordx.gains.certificate import CertifiedDesign, signed
from rotordx.gains.commands import designable
from rotordx.gains.design import design_file
from rotordx.gains.options import with_settings
from rotordx.gains.verify import differences, write_proved

#: Relative agreement, per array, of two designs that count as the same.
TOLERANCE = 1e-4

#: Settings that are not the defaults, by vehicle: after its paper's fault the F450 turns at 2.5 rad/s.
FOR_VEHICLE: dict[str, tuple[str, ...]] = {"f450_plus": ("body_rate=[3.0, 3.0, 1.5]",)}

#: And by vehicle and diagnoser: the learning rate of the paper that the vehicle comes from; what finds a loss within
#: 0.45 s, motor lag included.
FOR_DIAGNOSER: dict[tuple[str, str], tuple[str, ...]] = {
    ("ren_plus", "hinf"): ("speed=1.2",),
    ("ren_plus", "fast_adaptive"): ("speed=1.2",),
    ("f450_plus", "adaptive_thau"): ("learning_rate=[0.005, 0.005, 0.005]",),
    ("f450_plus", "asmto"): ("learning_rate=[0.005, 0.005, 0.005]",),
}


def packaged_designs() -> Path:
    """Folder of the packaged designs, one folder per vehicle in it."""
    return Path(str(resources.files("rotordx.fmus.vehicles"))) / "designs"


def make(vehicle: str, diagnoser: str) -> CertifiedDesign:
    """Design the gains of a diagnoser for a packaged vehicle, as they are packaged."""
    module = import_module(f"rotordx.gains.{diagnoser}")
    settings = (*FOR_VEHICLE.get(vehicle, ()), *FOR_DIAGNOSER.get((vehicle, diagnoser), ()))
    options = with_settings(module.Options(), settings)
    design: CertifiedDesign = module.design(load_vehicle(vehicle), options)
    return design


def same(design: CertifiedDesign, path: Path) -> bool:
    """Whether a file holds a design, up to the tolerance."""
    try:
        stored = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    new = signed(design)
    return not list(differences(stored | {"digest": ""}, new | {"digest": ""}, TOLERANCE))


def main() -> None:
    """Make all packaged designs; print what changed, and the time for each vehicle."""
    folder = packaged_designs()
    for vehicle in vehicle_names():
        start = perf_counter()
        for diagnoser in designable():
            design = make(vehicle, diagnoser)
            if not same(design, design_file(folder, vehicle, diagnoser)):
                print(write_proved(design, folder))
        print(f"{vehicle}: {len(designable())} diagnosers in {perf_counter() - start:.1f} s")


if __name__ == "__main__":
    main()
