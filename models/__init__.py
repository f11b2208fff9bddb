"""What is known about a robot, its task and its friction: data and pure mathematics."""

from pathlib import Path


def forget_stale_kernels(folder: Path) -> None:
    """Deletes compiled kernels that are older than the newest source of any kernel.

    numba keeps compiled kernels beside their source and compiles one anew when its own file
    changes, but not when a kernel that it calls changes in another file: without this, an updated
    installation would silently go on computing with the old code.
    """
    cached = list(folder.rglob("__pycache__/*.nb[ic]"))
    sources = {file.parent.parent / f"{file.name.split('.')[0]}.py" for file in cached}
    try:
        newest = max((source.stat().st_mtime for source in sources if source.exists()), default=0.0)
        for file in cached:
            if file.stat().st_mtime < newest:
                file.unlink(missing_ok=True)
    except OSError:  # another process was faster, or the folder is read only: numba copes with both
        pass


forget_stale_kernels(Path(__file__).parent)
