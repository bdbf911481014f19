"""What happens to files: each takes content and a generator and returns it damaged."""


def cut(content, generator):
    return content[: generator.integers(len(content))]


def flip_bits(content, generator):
    damaged = bytearray(content)
    for position in generator.integers(len(damaged), size=generator.integers(1, 8)):
        damaged[position] ^= 1 << generator.integers(8)
    return damaged


def scribble_on_structure(content, generator):
    """At both ends, where headers and indexes are."""
    damaged = bytearray(content)
    for position in generator.integers(min(len(damaged), 600), size=3):
        damaged[position] = generator.integers(256)
    for position in generator.integers(min(len(damaged), 3000), size=3):
        damaged[-1 - position] = generator.integers(256)
    return damaged


def change_a_length(content, generator):
    damaged = bytearray(content)
    position = generator.integers(len(damaged) - 8)
    lengths = (2**64 - 1, 0, 2**31 - 1, 2**32, 2**62)
    damaged[position : position + 8] = lengths[generator.integers(5)].to_bytes(8, "little")
    return damaged


def remove_a_part(content, generator):
    start, end = sorted(generator.integers(len(content), size=2))
    return content[:start] + content[end:]


def swap_magic(content, generator):
    magics = (b"\x89MCAP0\r\n", b"SQLite format 3\0", b"#ROSBAG V2.0\n", bytes(8))
    magic = magics[generator.integers(4)]
    return magic + content[len(magic) :]


DAMAGES = (cut, flip_bits, scribble_on_structure, change_a_length, remove_a_part, swap_magic)
