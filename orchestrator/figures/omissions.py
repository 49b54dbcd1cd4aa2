"""What a recording does not hold of a flight, or not all of: its figures leave that out."""

from orchestrator.recording.reader import Recording

# roles of the scene that figures are taken from
ROLES = (
    "pose", "velocity", "clearance", "load_factor", "controls", "reference", "height_agl", "ladder",
)  # fmt: skip


def thinned(recording: Recording, name: str) -> int:
    """Return of how many messages of a variable or group one was recorded."""
    signals = recording.signals.values()
    topics = {s.topic for s in signals if s.name == name or s.name.startswith(f"{name}.")}
    return max((int(recording.topics[t].metadata.get("every", "1")) for t in topics), default=1)


def omissions(recording: Recording) -> list[str]:
    """Return, in words, what the figures of a recording do not count."""
    said: list[str] = []
    for role in ROLES:
        name = recording.scene.get(role, "")
        if not name:
            continue
        if not any(s == name or s.startswith(f"{name}.") for s in recording.signals):
            said.append(f"{role}: {name} was not recorded")
        elif (n := thinned(recording, name)) > 1:
            what = "is not counted" if role == "ladder" else "is what the figures are taken from"
            said.append(f"{role}: one message of {n} of {name} was recorded, and {what}")
    if recording.recovered:
        said.append(f"recovered: lost {recording.recovered.get('reason', '')}")
    return said
