#!/usr/bin/env python3
"""Trains one scene on many machines: shards of the frames, then a tree of merges.

Every task is one call of `vbgs-studio`; this script schedules the tasks and moves checkpoints
between them. With Ray (`pip install ray`) tasks run wherever the cluster has free cores; `--local`
runs them on this machine and needs no installation.

    distribute.py room --out run --shards 16 --local
    distribute.py /shared/city --out run --shards 512 --threads 8      # on a Ray cluster

The dataset must be readable under the same path on every machine. Checkpoints travel through Ray's
object store, so no machine writes to a shared folder.
"""

import argparse
import concurrent.futures
import os
import pathlib
import subprocess
import sys
import tempfile
import time

# Components of a scene are born from points, so each shard would have its own. All shards therefore
# resume one short run over every so-many-th frame. Mixtures have the same components from the start.
MIXTURE = ["--preset", "paper"]


def run_program(program, arguments):
    """Runs one command; raises RuntimeError with the last line of its messages if it fails."""
    done = subprocess.run([program, *arguments], capture_output=True, text=True)
    if done.returncode != 0:
        command = " ".join([program, *arguments])
        said = done.stderr.strip().splitlines() or ["no message"]
        raise RuntimeError(f"{command}: exit status {done.returncode}: {said[-1]}")


def train_shard(program, dataset, shard, threads, options, start=None):
    """Task: trains one shard, resuming `start` if given; returns the checkpoint's bytes and the
    seconds it took."""
    started = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        arguments = ["train", dataset, "--out", folder, "--shard", shard, *options]
        if start:
            arguments += ["--resume", saved(folder, "start", start)]
        if threads:
            arguments += ["--threads", str(threads)]
        run_program(program, arguments)
        content = pathlib.Path(folder, "checkpoint.vbgs").read_bytes()
    return content, time.monotonic() - started


def saved(folder, name, part):
    """Writes the checkpoint of a task to a file in a folder; returns its path."""
    path = os.path.join(folder, f"{name}.vbgs")
    pathlib.Path(path).write_bytes(part[0])
    return path


def merge(program, start, *parts):
    """Task: merges checkpoints, which resumed `start` if given; returns the bytes of the result
    and the seconds it took."""
    started = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        names = [saved(folder, i, part) for i, part in enumerate(parts)]
        out = os.path.join(folder, "merged.vbgs")
        origin = ["--start", saved(folder, "start", start)] if start else []
        run_program(program, ["merge", *names, "-o", out, *origin])
        content = pathlib.Path(out).read_bytes()
    return content, time.monotonic() - started


class Local:
    """Runs tasks on this machine, `workers` at a time."""

    def __init__(self, workers):
        # Threads suffice: each only waits for a process.
        self.pool = concurrent.futures.ThreadPoolExecutor(workers)

    def submit(self, task, *arguments):
        return self.pool.submit(task, *arguments)

    def submit_merge(self, program, start, parts):
        return self.pool.submit(merge, program, start, *[part.result() for part in parts])

    def share(self, result):
        return result

    def result(self, handle):
        return handle.result()


class Cluster:
    """Runs tasks on a Ray cluster, `threads` cores each. Ray repeats a task if its machine is lost,
    which is safe: a task has no effect except its checkpoint."""

    def __init__(self, threads):
        try:
            import ray
        except ImportError:
            sys.exit("error: Ray is not installed: `pip install ray`, or use --local")
        ray.init()
        self.ray = ray
        self.cores = max(threads, 1)

    def submit(self, task, *arguments):
        return self.ray.remote(task).options(num_cpus=self.cores, max_retries=3).remote(*arguments)

    def submit_merge(self, program, start, parts):
        # Passes handles: Ray moves the bytes directly to the machine that merges.
        task = self.ray.remote(merge).options(num_cpus=1, max_retries=3)
        return task.remote(program, start, *parts)

    def share(self, result):
        # Stores the bytes once instead of once per task.
        return self.ray.put(result)

    def result(self, handle):
        return self.ray.get(handle)


def merge_tree(executor, program, start, parts, fan_in):
    """Merges `fan_in` at a time, level by level; returns the last handle and the depth."""
    depth = 0
    while len(parts) > 1:
        groups = [parts[i : i + fan_in] for i in range(0, len(parts), fan_in)]
        # A group of one moves up to the next level unmerged.
        parts = [g[0] if len(g) == 1 else executor.submit_merge(program, start, g) for g in groups]
        depth += 1
    return parts[0], depth


def parse():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("dataset", help="dataset, as for `vbgs-studio train`")
    parser.add_argument("--out", required=True, help="folder for checkpoint.vbgs and scene.ply")
    parser.add_argument("--shards", type=int, required=True, help="tasks that share the frames")
    parser.add_argument("--fan-in", type=int, default=8, help="checkpoints that one merge adds [8]")
    start = "every so-many-th frame is in the run that shards of a scene resume [8]"
    parser.add_argument("--start", type=int, default=8, help=start)
    parser.add_argument("--threads", type=int, default=0, help="threads per shard [one per core]")
    parser.add_argument("--local", action="store_true", help="run on this machine, without Ray")
    parser.add_argument("--workers", type=int, default=1, help="shards at a time with --local [1]")
    parser.add_argument("--program", default="vbgs-studio", help="the program [vbgs-studio]")
    parser.epilog = "Options after `--` are passed to `vbgs-studio train` for every shard."
    given = sys.argv[1:]
    end = given.index("--") if "--" in given else len(given)
    arguments = parser.parse_args(given[:end])
    arguments.train_options = given[end + 1 :]
    if min(arguments.shards, arguments.start, arguments.workers) < 1 or arguments.fan_in < 2:
        parser.error("expected --fan-in of 2 or more, and the other numbers of 1 or more")
    return arguments


def main():
    asked = parse()
    out = pathlib.Path(asked.out)
    out.mkdir(parents=True, exist_ok=True)
    executor = Local(asked.workers) if asked.local else Cluster(asked.threads)
    dataset = os.path.abspath(asked.dataset)
    options = asked.train_options
    start = None
    if not any(options[i : i + 2] == MIXTURE for i in range(len(options))):
        task = (train_shard, asked.program, dataset, f"1/{asked.start}", asked.threads, options)
        start = executor.share(executor.result(executor.submit(*task)))
    n = asked.shards
    started = time.monotonic()
    shards = [
        executor.submit(
            train_shard, asked.program, dataset, f"{k}/{n}", asked.threads, options, start
        )
        for k in range(1, n + 1)
    ]
    last, depth = merge_tree(executor, asked.program, start, shards, asked.fan_in)
    content, merge_s = executor.result(last)
    checkpoint = out / "checkpoint.vbgs"
    # Writes to another name first, so that readers never see a partial file.
    partial = checkpoint.with_suffix(".partial")
    partial.write_bytes(content)
    os.replace(partial, checkpoint)
    run_program(asked.program, ["export", str(checkpoint), "-o", str(out / "scene.ply")])
    seconds, megabytes = time.monotonic() - started, len(content) * 1e-6
    print(
        f"{n} shards, {depth} levels of merges by {asked.fan_in}, the last took {merge_s:.2f} s; "
        f"in {seconds:.1f} s: {checkpoint} ({megabytes:.1f} MB) and {out / 'scene.ply'}"
    )


if __name__ == "__main__":
    try:
        main()
    except RuntimeError as error:
        sys.exit(f"error: {error}")
