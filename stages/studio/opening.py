"""Recordings of any format as BVHs of a session. Of several clips in a file or an archive, the user chooses one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path, PurePosixPath

from data_schemas.errors import InputError, UsageError
from data_schemas.whole_file import write_whole
from stages.registry import stage_named
from stages.shared.formats.archives import archive_suffix
from stages.shared.formats.readers import recognise, recordings_in
from stages.shared.formats.recording import Asked
from stages.shared.formats.sources import Source, source_named
from stages.studio.folder import recordings_of_archive
from stages.studio.scratch import scratch_folder
from stages.studio.worker import config_of


class SeveralClipsError(UsageError):
    """A file holds several clips, and none was chosen. clips: their names."""

    def __init__(self, name: str, clips: Sequence[str]) -> None:
        super().__init__(f"{name} holds {len(clips)} clip{'s' * (len(clips) > 1)}.", "Choose one.")
        self.clips = list(clips)


def write_as_bvh(data: bytes, path: Path | str | None, name: str, bvh: Path, clip: str) -> bool:
    """Write a recording as a BVH; whether it was of another format.

    Args:
        data: its bytes. path: where it lies, FILE or ARCHIVE!MEMBER; None if it was dropped on the page.
        clip: the one to write of several.

    Raises: SeveralClipsError where it holds several and has none of that name; InputError where it is no recording.
    """
    chosen = recognise(data, name)
    if chosen is None:
        raise InputError(f"{name} is not a recording in a format that pumps reads.", "Open another file.")
    if chosen.name == "bvh":
        write_whole(bvh, data)
        return False
    draft = bvh.with_name(f"{bvh.stem}.dropped{PurePosixPath(name).suffix}")
    try:
        if path is None:
            write_whole(draft, data)
        source = source_named(str(path or draft))
        values = {"input": source.name, "output": bvh, **({"clip": (clip_name(source, clip),)} if clip else {})}
        try:
            stage_named("export").runner()(config_of("export", values))
        except (InputError, UsageError):
            clips = [recording.part for recording in recordings_in(source, Asked())]
            if len(clips) < 2 or clip in clips:
                raise
            raise SeveralClipsError(name, clips) from None
    finally:
        draft.unlink(missing_ok=True)
    return True


def clip_name(source: Source, clip: str) -> str:
    """The name by which `pumps export --clip` finds one of several clips of a file."""
    return f"{PurePosixPath(source.member).stem}.{clip}"


def member_of(archive: Path, name: str, clip: str) -> tuple[str, str]:
    """The member of an archive that `clip`, MEMBER or MEMBER!CLIP, names, and the clip in it.

    Raises: SeveralClipsError where there is no such member; InputError where there is none to choose.
    """
    members = recordings_of_archive(archive)
    if not members:
        raise InputError(f"{name} holds no recording that pumps reads.", "Open another file.")
    member = next((each for each in members if clip == each or clip.startswith(f"{each}!")), None)
    if not clip and len(members) == 1:
        member = members[0]
    if member is None:
        raise SeveralClipsError(name, members)
    return member, clip[len(member) + 1 :]


@contextmanager
def inside(member: str) -> Iterator[None]:
    """Name the clips of a member of an archive MEMBER!CLIP, as `member_of` takes them."""
    try:
        yield
    except SeveralClipsError as error:
        raise SeveralClipsError(member, [f"{member}!{each}" for each in error.clips]) from None


@contextmanager
def dropped(name: str, data: bytes, clip: str, folder: Path) -> Iterator[tuple[bytes, str | None, str, str]]:
    """Bytes, path, name and clip of a file that was dropped on the page; of an archive, those of one of its files.

    Args:
        clip: as `member_of` takes it, if the file is an archive.
        folder: that of the sessions, in which an archive lies as long as it is read.
    """
    if not archive_suffix(name):
        yield data, None, name, clip
        return
    with scratch_folder(folder) as held:
        path = held / name
        write_whole(path, data)
        member, clip = member_of(path, name, clip)
        source = source_named(f"{path}!{member}")
        with inside(member):
            yield source.read(), source.name, PurePosixPath(member).name, clip
