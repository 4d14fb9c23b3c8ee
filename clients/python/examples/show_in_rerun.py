"""Shows a server's map in rerun, again whenever it has changed; or writes it into a file.

python show_in_rerun.py                          # opens the viewer, follows until Ctrl-C
python show_in_rerun.py --save map.rrd --once
"""

from __future__ import annotations

import argparse
import time

import rerun as rr

import orenx
from orenx import viewer

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("url", nargs="?", default="grpc://127.0.0.1:7610")
    parser.add_argument("--map", default="default")
    parser.add_argument("--voxel", type=float, default=0.05)
    parser.add_argument("--slice", type=float, help="height of a slice, m")
    parser.add_argument("--save", help="a file instead of the viewer")
    parser.add_argument("--once", action="store_true")
    options = parser.parse_args()
    rr.init("orenx", spawn=options.save is None)
    if options.save:
        rr.save(options.save)
    with orenx.connect(options.url) as client:
        m, seen = client.map(options.map), -1
        while True:
            epoch = m.info().epoch
            if epoch != seen:
                seen = epoch
                print(
                    f"epoch {epoch}: {viewer.log(m, voxel_m=options.voxel, slice_z_m=options.slice)} points"
                )
            if options.once:
                break
            time.sleep(1)
