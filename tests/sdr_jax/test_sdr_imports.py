import subprocess
import sys


def test_importing_sdr_jax_imports_nothing_of_scenes_images_or_experiments() -> None:
    code = (
        "import sys, sdr_jax; "
        "print(*{name.split('.')[0] for name in sys.modules}"
        " & {'scene', 'seg', 'experiments', 'cv2', 'trimesh', 'pyrender'})"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == []
