"""What a scene may set of a spool: the key `spool` of any output."""

from attrs import frozen

from opir_core.scene.fields import flag, number, text

#: What a spool does when it is full.
REFUSE, WAIT, DROP_OLDEST, DROP_NEWEST = "refuse", "wait", "drop-oldest", "drop-newest"
_MIB = 1 << 20


@frozen(kw_only=True)
class SpoolConfig:
    """Where events are kept until they are acknowledged, how many, and what gives way when there is no more room."""

    path: str = text(help="the spool's file (SQLite), made if it is not there, in a folder that exists", source="")
    max_bytes: int = number(
        default=1024 * _MIB,
        unit="bytes",
        minimum=_MIB,
        maximum=1 << 44,
        help="the most that the file may grow to; SQLite's journal beside it takes a few MiB more",
    )
    when_full: str = text(
        default=REFUSE,
        choices=(REFUSE, WAIT, DROP_OLDEST, DROP_NEWEST),
        help="what gives way when the spool is full: refuse fails the output and keeps what is in the spool; wait holds"
        " the run until there is room; drop-oldest and drop-newest lose events, and count them",
    )
    wait_s: float = number(
        default=60.0, unit="s", minimum=0.0, maximum=86_400.0, help="how long wait waits before it refuses"
    )
    survives_power_cut: bool = flag(
        default=False,
        help="whether each write waits for the disk itself; without it events survive the end of the process, however"
        " it comes, but the last may be lost when the machine loses power",
    )

    def __attrs_post_init__(self) -> None:
        if not self.path or "\0" in self.path:
            raise ValueError("the spool's path is empty; give the path of a file")
