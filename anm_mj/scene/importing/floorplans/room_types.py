"""What rooms are for, where a plan says it, and where only their shape does."""

import shapely

_WORDS = {
    "living": "living", "lounge": "lounge", "kitchen": "kitchen", "dining": "dining", "bed": "bedroom",
    "child": "child", "kid": "child", "guest": "bedroom", "bath": "bathroom", "toilet": "bathroom",
    "shower": "bathroom", "hall": "corridor", "corridor": "corridor", "entr": "corridor", "lobby": "reception",
    "office": "study", "study": "study", "storage": "storage", "closet": "storage", "wardrobe": "storage",
    "garage": "storage", "boiler": "storage", "laundry": "storage", "gym": "hobby", "hobby": "hobby",
}  # fmt: skip
_SMALL_M2, _MEDIUM_M2, _LARGE_M2 = 7.0, 21.0, 38.0
_CORRIDOR_DOORS = 4


def room_type_of_word(word: str) -> str | None:
    """The room type that a plan's own word for a room means, if any."""
    lower = word.lower()
    return next((room_type for part, room_type in _WORDS.items() if part in lower), None)


def office_room_type(floor: shapely.Polygon, num_doors: int, index: int) -> str:
    """What a room of an office building is for, by its size and shape."""
    area = float(floor.area)
    # How many times longer than wide a rectangle of the same area and outline would be.
    width = area / max(float(floor.length) / 2.0, 1e-6)
    length = area / max(width, 1e-6)
    if num_doors >= _CORRIDOR_DOORS or (length > 4.5 * width and num_doors > 1):
        return "corridor" if area < 150.0 or width < 2.5 else "lounge"
    if area < _SMALL_M2:
        return ("storage", "washroom", "archive")[index % 3]
    if area < _MEDIUM_M2:
        return ("office", "office", "meeting", "office", "break room")[index % 5]
    if area < _LARGE_M2:
        return ("meeting", "laboratory", "office", "reception")[index % 4]
    return ("open office", "laboratory", "lounge", "open office")[index % 4]
