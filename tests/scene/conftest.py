"""A folder of own assets to fill; and shared checks whose failures say what was found."""

import pytest

pytest.register_assert_rewrite("tests.scene.asset_checks")


@pytest.fixture
def shelf(tmp_path):
    """``shelf(path, mesh_or_bytes, column=...)`` puts a file there with its row; gives the folder."""
    folder = tmp_path / "own"
    rows: list[dict[str, str]] = []

    def put(name, content, listed=True, **columns):
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if isinstance(content, bytes):
            path.write_bytes(content)
        else:
            content.export(path)
        if listed:
            row = {"file": name, "author": "A. Maker", "licence": "CC0-1.0", "source": "own work"}
            rows.append({**row, **columns})
        header = list(dict.fromkeys(key for row in rows for key in row))
        lines = [header, *([row.get(key, "") for key in header] for row in rows)]
        text = "".join(",".join(line) + "\n" for line in lines)
        (folder / "assets.csv").write_text(text, encoding="utf-8")
        return str(folder)

    return put
