"""Each export is read by its own program: VTK, YADE's SpherePack, LAMMPS and xarray (see also test_statistics)."""

import json
import shutil
import subprocess

import numpy as np
import pytest

import labkit as lk
from labkit.errors import InputError
from labkit.plugins.exchange import FORMATS
from tests.conftest import PATIENCE

pytestmark = pytest.mark.slow


def test_ondem_is_read_by_vtk(straight, tmp_path):
    """Points, vertices and arrays, by the reader that ParaView uses."""
    pytest.importorskip("h5py", reason="h5py is not installed")
    reading = pytest.importorskip("vtkmodules.vtkIOHDF", reason="vtk is not installed")
    from vtkmodules.util.numpy_support import vtk_to_numpy

    FORMATS["ondem"]().write(straight, tmp_path / "s.vtkhdf")
    reader = reading.vtkHDFReader()
    reader.SetFileName(str(tmp_path / "s.vtkhdf"))
    reader.Update()
    data = reader.GetOutputDataObject(0)
    assert data.GetNumberOfPoints() == data.GetNumberOfVerts() == straight.number_of_grains
    np.testing.assert_array_equal(vtk_to_numpy(data.GetPoints().GetData()), straight.position)
    arrays = data.GetPointData()
    np.testing.assert_array_equal(vtk_to_numpy(arrays.GetArray("radius")), straight.radius)


def test_a_sphere_pack_is_read_by_yade(straight, tmp_path):
    FORMATS["sphere_pack"]().write(straight, tmp_path / "s.spheres")
    script = tmp_path / "load.py"
    script.write_text(
        "import json, sys\nfrom yade import pack\np = pack.SpherePack()\np.load(sys.argv[1])\n"
        "json.dump([list(p.cellSize), [[*c, r] for c, r in p]], open(sys.argv[2], 'w'))\n"
    )
    output = tmp_path / "read.json"
    command = ["yade", "-n", "-x", str(script), str(tmp_path / "s.spheres"), str(output)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE)
    assert done.returncode == 0, done.stdout + done.stderr
    lengths, rows = json.loads(output.read_text())
    np.testing.assert_allclose(lengths, np.diag(straight.cell), rtol=1e-12)
    np.testing.assert_allclose(rows, np.column_stack([straight.position, straight.radius]), rtol=1e-12)


def test_a_data_file_is_read_by_lammps(sheared, tmp_path):
    """LAMMPS counts the grains and gives the volume of the rotated cell and the largest radius."""
    if shutil.which("lmp") is None:
        pytest.skip("LAMMPS is not installed: apt-get install lammps")
    FORMATS["lammps_data"]().write(sheared, tmp_path / "s.data")
    (tmp_path / "in.lmp").write_text(
        "units si\natom_style sphere\nread_data s.data\ncompute r all property/atom radius\n"
        "compute m all reduce max c_r\nthermo_style custom step atoms vol c_m\n"
        "thermo_modify format float %20.15g\nrun 0\n"
    )
    done = subprocess.run(["lmp", "-in", "in.lmp", "-log", "none"], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    row = next(
        line.split() for line in done.stdout.splitlines() if line.split()[:1] == ["0"] and len(line.split()) == 4
    )
    assert int(row[1]) == sheared.number_of_grains
    np.testing.assert_allclose([float(row[2]), float(row[3])], [sheared.volume, sheared.radius.max()], rtol=1e-12)


def test_a_sphere_pack_of_a_free_cell_is_refused_with_what_to_do(tmp_path):
    state = lk.make_specimen(lk.Recipe(void_ratio=0.67, grains=100), progress=False)
    with pytest.raises(InputError, match="lammps_data or ondem, or make the specimen with --cell fixed"):
        FORMATS["sphere_pack"]().write(state, tmp_path / "s.spheres")
    assert not (tmp_path / "s.spheres").exists()
