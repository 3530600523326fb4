"""A model's folder as the bytes of a zip file: so a log holds the model of its run, wherever that goes afterwards."""

from __future__ import annotations

import io
import re
import zipfile
import zlib
from pathlib import Path
from tempfile import TemporaryDirectory

from mazeplan.errors import ModelError
from mazeplan.models.modelfile import RigModel, load_model, save_model

ATTACHED, MEDIA_TYPE = "model.zip", "application/zip"
LARGEST = 32 * 2**20  # bytes, unpacked; ours have one or two MB
MEMBER = re.compile(r"model\.yaml|ring[0-9]{1,3}\.npz")


def packed_model(model: RigModel) -> bytes:
    """The same bytes for the same model. Raises ModelError where it cannot be told in files, or in too long ones."""
    out = io.BytesIO()
    with TemporaryDirectory(prefix="mazeplan-model-") as folder:
        save_model(model, folder)
        with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as packed:
            for path in sorted(Path(folder).iterdir()):
                packed.writestr(zipfile.ZipInfo(path.name), path.read_bytes(), zipfile.ZIP_DEFLATED)  # dated 1980
            size = sum(member.file_size for member in packed.infolist())
    if size > LARGEST:
        raise ModelError(f"got {size / 2**20:.0f} MB, expected at most {LARGEST // 2**20}")
    return out.getvalue()


def unpacked_model(data: bytes) -> RigModel:
    """Raises ModelError for what `packed_model` did not make."""
    with TemporaryDirectory(prefix="mazeplan-model-") as folder:
        try:
            with zipfile.ZipFile(io.BytesIO(data)) as packed:
                members = packed.infolist()
                strange = next((m.filename for m in members if not MEMBER.fullmatch(m.filename)), None)
                if strange is not None:
                    raise ModelError(f"got a file {strange[:60]!r} in it, expected model.yaml and ring1.npz ...")
                if sum(m.file_size for m in members) > LARGEST:
                    raise ModelError(f"got more than {LARGEST // 2**20} MB unpacked")
                packed.extractall(folder)
        except (zipfile.BadZipFile, zlib.error, OSError, ValueError, RuntimeError) as problem:
            raise ModelError(f"is no packed model: {problem}") from None
        return load_model(folder)
