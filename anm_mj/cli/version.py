"""What this program calls itself."""


def version() -> str:
    """The version, and of a checkout its revision."""
    from importlib import metadata

    from anm_mj.io.manifest import git_revision
    from anm_mj.utils.package_data import checkout

    folder = checkout()
    git = None if folder is None else git_revision(folder)
    revision = f" (revision {git['revision'][:12]}{', changed' if git['changed'] else ''})" if git else ""
    return metadata.version("anm-mj") + revision
