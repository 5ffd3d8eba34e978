"""Results on disk, each under a hash of everything that it depends on."""
import hashlib
import json
import os
import tempfile


def file_hash(*paths):
    """Of names and contents."""
    digest = hashlib.sha256()
    for path in paths:
        with open(path, "rb") as file:
            content = file.read()
        digest.update(f"{os.path.basename(path)} {len(content)} ".encode() + content)
    return digest.hexdigest()[:16]


class Cache:
    """Maps keys (JSON values) to results (JSON values); complete files only, so any run may be cut off."""

    def __init__(self, folder):
        self.folder = folder
        os.makedirs(folder, exist_ok=True)

    def _path(self, key):
        text = json.dumps(key, sort_keys=True)
        return os.path.join(self.folder, hashlib.sha256(text.encode()).hexdigest()[:32] + ".json")

    def get(self, key):
        """None where there is no result yet."""
        try:
            with open(self._path(key), encoding="utf-8") as file:
                return json.load(file)["result"]
        except FileNotFoundError:
            return None

    def put(self, key, result):
        with tempfile.NamedTemporaryFile("w", dir=self.folder, delete=False, encoding="utf-8") as file:
            json.dump({"key": key, "result": result}, file)
        os.replace(file.name, self._path(key))
