import pytest


@pytest.fixture
def write(tmp_path):
    """Content -> path of a file that holds it."""

    def _write(content, name="record.csv"):
        path = tmp_path / name
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    return _write
