"""Writes evo_fixture.txt: trajectory errors as evo computes them (pip install evo; made with 1.38.1).

Usage: cargo test -p draco-pgo --test evaluation -- --ignored print_trajectories
       python evo_fixture.py FOLDER > evo_fixture.txt
FOLDER is the temporary folder the first command wrote *_estimate.tum and *_reference.tum to.
"""
import contextlib, copy, sys
from evo.core import metrics
from evo.core.metrics import PoseRelation, Unit
from evo.tools import file_interface

RELATIONS = {
    "translation": PoseRelation.translation_part,
    "angle": PoseRelation.rotation_angle_rad,
    "rotation": PoseRelation.rotation_part,
    "full": PoseRelation.full_transformation,
    "distance": PoseRelation.point_distance,
}
UNITS = {"f": Unit.frames, "m": Unit.meters, "r": Unit.radians}
RPES = ["rpe:f1", "rpe:f7", "rpe:m2.5", "rpe:r0.5", "all:f3", "all:m1.5", "all:r0.7"]


def aligned(estimate, reference, how):
    moved = copy.deepcopy(estimate)
    if how == "rigid":
        moved.align(reference)
    elif how == "similarity":
        moved.align(reference, correct_scale=True)
    elif how == "scale":
        moved.align(reference, correct_only_scale=True)
    elif how == "origin":
        moved.align_origin(reference)
    return moved


def emit(space, which, relation, how, metric, pair):
    with contextlib.redirect_stdout(sys.stderr):  # evo prints its progress
        metric.process_data(pair)
    s = metric.get_all_statistics()
    values = [s[k] for k in ("rmse", "mean", "median", "std", "min", "max", "sse")]
    print(space, which, relation, how, len(metric.error), *(repr(float(v)) for v in values))


print("# space|plane what relation alignment count rmse mean median std min max sse; see evo_fixture.py")
for space in ("space", "plane"):
    estimate, reference = (
        file_interface.read_tum_trajectory_file(f"{sys.argv[1]}/{space}_{name}.tum") for name in ("estimate", "reference")
    )
    for how in ("none", "rigid", "similarity", "scale", "origin"):
        moved = aligned(estimate, reference, how)
        for name, relation in RELATIONS.items():
            emit(space, "ate", name, how, metrics.APE(relation), (reference, moved))
    for which in RPES:
        kind, delta = which.split(":")
        for how in ("none", "similarity"):
            moved = aligned(estimate, reference, how)
            for name, relation in RELATIONS.items():
                size = int(delta[1:]) if delta[0] == "f" else float(delta[1:])
                metric = metrics.RPE(relation, size, UNITS[delta[0]], 0.1, kind == "all")
                emit(space, which, name, how, metric, (reference, moved))
