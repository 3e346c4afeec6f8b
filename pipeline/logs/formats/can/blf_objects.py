"""The objects of a BLF file (Vector's binary log), intact or damaged, in containers that `python-can` can read.

A file is a header and containers, each plain or compressed; the containers' contents follow one another as a stream of
objects, which may begin in one container and end in the next. Source: `python-can`'s reader, which stops at the first
damage and allocates whatever a container declares.
"""

import struct
import zlib
from collections.abc import Iterator
from io import BytesIO

from pipeline.errors import InputError
from pipeline.logs.formats.opened_file import OpenedFile

FILE_SIGNATURE, SIGNATURE = b"LOGG", b"LOBJ"
FILE_HEADER = struct.Struct("<4sL24xL")  # signature, length of the header, number of objects
OBJECT = struct.Struct("<4sHHLL")  # signature, length of the header, its version, length of the object, type
CONTAINER = struct.Struct("<H6xL4x")  # compression, length when decompressed
CONTAINER_TYPE, PLAIN, DEFLATED = 10, 0, 2
LEAST_HEADER_BYTES, MAXIMUM_HEADER_BYTES = 144, 1 << 12
MAXIMUM_CONTAINER_BYTES = 1 << 25  # recorders write 128 KiB
MAXIMUM_OBJECT_BYTES = 1 << 16  # of a frame; longer objects are not frames
PADDING = 8  # objects may be followed by up to as many bytes


def readable_pieces(opened: OpenedFile) -> Iterator[BytesIO]:
    """Yield files of whole objects, one per container; damage is noted in the ledger.

    Raises:
        InputError: It is not a BLF file.
    """
    head = opened.file.read(MAXIMUM_HEADER_BYTES)
    if len(head) < LEAST_HEADER_BYTES or not head.startswith(FILE_SIGNATURE):
        raise InputError(f"{opened.path}: not a BLF file, or cut off within its header; remove it")
    _, length, n_stated = FILE_HEADER.unpack_from(head)
    if not LEAST_HEADER_BYTES <= length <= len(head):
        opened.ledger.damage(4, f"the header declares {length} bytes; {LEAST_HEADER_BYTES} are taken")
        length = LEAST_HEADER_BYTES
    header = bytearray(head[:length])
    header[4:8] = struct.pack("<L", length)
    tail, n_objects = b"", 0
    for offset, content in _containers(opened, length):
        objects, tail = _whole_objects(tail + content, offset, opened)
        n_objects += len(objects)
        inside = b"".join(objects)
        size = OBJECT.size + CONTAINER.size + len(inside)
        container = OBJECT.pack(SIGNATURE, OBJECT.size, 1, size, CONTAINER_TYPE) + CONTAINER.pack(
            PLAIN, len(inside)
        )
        yield BytesIO(bytes(header) + container + inside + bytes(size % 4))
    if n_objects < n_stated:
        opened.ledger.damage(
            None, f"the file states {n_stated} objects; {n_objects} were read", n_stated - n_objects
        )


def _containers(opened: OpenedFile, position: int) -> Iterator[tuple[int, bytes]]:
    """Yield where each container stands and its decompressed content, or the front of a damaged one.

    Objects that stand in no container, as those of a plain container whose header is damaged, are yielded one by one.
    """
    while position + OBJECT.size <= opened.size:
        signature, _, _, size, kind = OBJECT.unpack(_bytes_at(opened, position, OBJECT.size))
        following = position + size + size % 4
        is_container = (signature, kind) == (SIGNATURE, CONTAINER_TYPE)
        is_sound = is_container and (
            following == opened.size or SIGNATURE in _bytes_at(opened, following, PADDING)
        )
        if not is_sound:
            following = _next_object(opened, position + 1)
        begin = position + OBJECT.size if is_container else position
        body = _bytes_at(opened, begin, min(following - begin, MAXIMUM_CONTAINER_BYTES))
        if signature != SIGNATURE:
            opened.ledger.damage(position, f"no BLF container stands here; {len(body)} bytes are lost")
        elif is_container:
            if following == opened.size < position + size:
                text = f"the file ends within this container; {len(body)} of its bytes are there"
                opened.ledger.damage(position, text)
            elif not is_sound:
                text = f"no BLF container stands here that has {size} bytes; it is read up to the next one"
                opened.ledger.damage(position, text)
            yield position, _decompressed(body, position, opened)
        else:
            yield position, body
        position = following


def _bytes_at(opened: OpenedFile, position: int, length: int) -> bytes:
    opened.file.seek(position)
    return opened.file.read(length)


def _next_object(opened: OpenedFile, position: int) -> int:
    """Where the next object may begin, or the file's size."""
    overlap = len(SIGNATURE) - 1
    while position < opened.size:
        opened.file.seek(position)
        piece = opened.file.read(1 << 16)
        if (found := piece.find(SIGNATURE)) >= 0:
            return position + found
        position += max(len(piece) - overlap, 1)
    return opened.size


def _decompressed(body: bytes, position: int, opened: OpenedFile) -> bytes:
    if len(body) < CONTAINER.size:
        return b""
    compression, _ = CONTAINER.unpack_from(body)
    content = body[CONTAINER.size :]
    if compression == PLAIN:
        return content
    if compression != DEFLATED:
        opened.ledger.damage(
            position, f"the container's compression is {compression}, which is not known; it is lost"
        )
        return b""
    decompressor, parts, n_bytes = zlib.decompressobj(), [], 0
    for begin in range(0, len(content), 1 << 12):
        waiting = content[begin : begin + (1 << 12)]
        try:
            part = decompressor.decompress(waiting, MAXIMUM_CONTAINER_BYTES - n_bytes + 1)
        except zlib.error as error:
            opened.ledger.damage(
                position, f"the container cannot be decompressed ({error}); its front was read"
            )
            break
        parts.append(part)
        n_bytes += len(part)
        if n_bytes > MAXIMUM_CONTAINER_BYTES:
            opened.ledger.damage(position, "the container becomes longer than recorders write; it is lost")
            return b""
        if decompressor.eof:
            break
    return b"".join(parts)


def _whole_objects(data: bytes, offset: int, opened: OpenedFile) -> tuple[list[bytes], bytes]:
    """The whole objects of a container's content, and the rest; `offset` is the container's place in the file."""
    objects, position, n_lost = [], 0, 0
    while True:
        begin = data.find(SIGNATURE, position)
        if begin < 0:
            n_lost += max(len(data) - position - PADDING, 0)
            rest = b""
            break
        n_lost += begin - position if begin - position > PADDING else 0
        if begin + OBJECT.size > len(data):
            rest = data[begin:]
            break
        _, header_length, _, size, _ = OBJECT.unpack_from(data, begin)
        swallowed = data.find(SIGNATURE, begin + len(SIGNATURE), begin + size)  # if its length is wrong
        if swallowed >= 0 or not OBJECT.size <= header_length <= size or size > MAXIMUM_OBJECT_BYTES:
            position = swallowed if swallowed >= 0 else begin + len(SIGNATURE)
            n_lost += position - begin
            continue
        if begin + size > len(data):
            rest = data[begin:]
            break
        objects.append(data[begin : begin + size] + bytes(size % 4))
        position = begin + size
    if n_lost:
        opened.ledger.damage(
            offset, f"{n_lost} bytes of the container that starts here hold no objects; they are lost"
        )
    return objects, rest
