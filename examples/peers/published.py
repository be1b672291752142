"""One step of the published implementation per frame, for the example `peers`."""

import copy
import json
import os
import sys
import time

# Maximum number of point-component pairs in memory at once.
PAIRS = 20_000_000


def say(answer):
    print(json.dumps(answer), flush=True)


def main(checkout, folder):
    sys.path[:0] = [checkout, os.path.join(checkout, "scripts")]
    try:
        import jax
        import jax.random as jr
        import numpy as np
        from model_volume import get_volume_delta_mixture
        from vbgs.model import train
        from vbgs.model.utils import random_mean_init
    except ImportError as missing:
        say({"error": f"{missing}; choose a checkout with --published and a Python with its dependencies with --python"})
        return
    # The function has different names in different versions.
    names = ("fit_gmm_step", "fit_delta_gmm_step")
    step = next((getattr(train, name) for name in names if hasattr(train, name)), None)
    if step is None:
        say({"error": f"vbgs.model.train has none of {names}: this version is not supported"})
        return
    with open(os.path.join(folder, "frames.json")) as file:
        described = json.load(file)
    n = described["told"]["components"]
    count = len(described["frames"])
    frames = [np.load(os.path.join(folder, f"points-{i}.npy")) for i in range(count)]
    # One batch size for all frames, because JAX compiles for a fixed size.
    batch = max(1, min(max(len(frame) for frame in frames), PAIRS // n))
    key, for_means, for_model = jr.split(jr.PRNGKey(0), 3)
    means = random_mean_init(
        key=for_means,
        x=None,
        component_shape=(n,),
        event_shape=(6, 1),
        init_random=True,
        add_noise=False,
    )
    initial = get_volume_delta_mixture(
        key=for_model,
        n_components=n,
        mean_init=means,
        beta=0,
        learning_rate=1,
        dof_offset=1,
        position_scale=n,
        position_event_shape=(3, 1),
    )
    model, sums = copy.deepcopy(initial), (None, None, None)
    say("ready")
    for line in sys.stdin:
        frame = frames[int(line)]
        begun = time.perf_counter()
        model, *sums = step(
            initial,
            model,
            data=frame,
            batch_size=batch,
            prior_stats=sums[0],
            space_stats=sums[1],
            color_stats=sums[2],
        )
        jax.block_until_ready(jax.tree_util.tree_leaves(sums))
        say({"ms": 1e3 * (time.perf_counter() - begun)})


main(*sys.argv[1:])
