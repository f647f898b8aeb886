"""Prints what the pictures of scripts/demo took, from the statistics beside them: demo_table.py out/NAME..."""

import json
import sys

print(f"{'picture':<32}{'by':<8}{'pixels':>10} {'samples':>8} {'triangles':>10} {'time':>8} {'rays/s':>9} {'relMSE':>9}  on")
for path in sys.argv[1:]:
    with open(path + ".json", encoding="utf-8") as file:
        done = json.load(file)
    s = done["statistics"]
    rays = s["num_camera_rays"] + s["num_bounce_rays"] + s["num_shadow_rays"]
    error = "unknown" if s["estimated_error"] is None else f"{s['estimated_error']:.2g}"
    print(
        f"{path + '.png, .exr':<32}{s['pipeline']:<8}{s['width']:>5} x {s['height']} {s['samples_per_pixel']:>8} "
        f"{done['facts']['world_triangles']:>10} {s['render_seconds']:>6.1f} s "
        f"{rays / s['render_seconds'] / 1e6:>7.2f} M {error:>9}  {s['accel']}, {done['device']['name']}"
    )
print("relMSE is the estimated error of the picture: mean((x - truth)^2 / (truth^2 + 0.01))")
