"""Writes the meshes of this folder. Needs gmsh, meshio, vtk (pip); two.node and two.ele come from
`tetgen -pAo1 two.poly`, the quadratic ones from `tetgen -pAo2 two.poly`."""

import gmsh
import meshio
import numpy as np
import vtk

rows = lambda name: np.array([l.split() for l in open(name).readlines()[1:] if l[0] != "#"], dtype=float)
nodes, tets = rows("two.node")[:, 1:4], rows("two.ele").astype(int)
regions = tets[:, 5]
tets = tets[:, 1:5]
on_left = lambda t: [[a, b, c] for a, b, c in [(t[1], t[2], t[3]), (t[0], t[3], t[2]), (t[0], t[1], t[3]), (t[0], t[2], t[1])]
                     if max(nodes[a][0], nodes[b][0], nodes[c][0]) == 0]
left = np.array([f for t in tets for f in on_left(t)])


def gmsh_model(named):
    gmsh.clear()
    mesh = gmsh.model.mesh
    gmsh.model.addDiscreteEntity(2, 1)
    for volume in (1, 2):
        gmsh.model.addDiscreteEntity(3, volume)
    # Tags with gaps, and nodes in two blocks.
    mesh.addNodes(2, 1, 10 * np.arange(6) + 5, nodes[:6].flatten())
    mesh.addNodes(3, 1, 10 * np.arange(6, 12) + 5, nodes[6:].flatten())
    tags = lambda cells: (10 * np.array(cells) + 5).flatten()
    mesh.addElementsByType(1, 2, [], tags(left))
    mesh.addElementsByType(1, 4, [], tags(tets[regions == 7]))
    mesh.addElementsByType(2, 4, [], tags(tets[regions == 9]))
    names = ["left side", "soft", "hard"] if named else ["", "", ""]
    # The surface's tag is one of the volumes' too.
    gmsh.model.addPhysicalGroup(2, [1], 7 if named else 1, names[0])
    gmsh.model.addPhysicalGroup(3, [1], 7, names[1])
    gmsh.model.addPhysicalGroup(3, [2], 9, names[2])


def gmsh_files(stem, orders=(1, 2)):
    for order in orders:
        if order == 2:
            gmsh.model.mesh.setOrder(2)
        for version in (2.2, 4.1):
            for binary in (0, 1):
                gmsh.option.setNumber("Mesh.MshFileVersion", version)
                gmsh.option.setNumber("Mesh.Binary", binary)
                name = stem + ("-quadratic" if order == 2 else "")
                gmsh.write(f"{name}-{version}-{'binary' if binary else 'ascii'}.msh")


gmsh.initialize()
gmsh.option.setNumber("General.Verbosity", 2)
gmsh_model(True)
gmsh_files("two")
gmsh_model(False)
gmsh_files("tags", [1])

# A ball of radius 10 with curved elements, everything saved, no group.
gmsh.clear()
gmsh.model.occ.addSphere(0, 0, 0, 10)
gmsh.model.occ.synchronize()
gmsh.option.setNumber("Mesh.MeshSizeMin", 20)
gmsh.option.setNumber("Mesh.MeshSizeMax", 20)
gmsh.model.mesh.generate(3)
gmsh.model.mesh.setOrder(2)
gmsh.option.setNumber("Mesh.MshFileVersion", 4.1)
gmsh.option.setNumber("Mesh.Binary", 1)
gmsh.option.setNumber("Mesh.SaveParametric", 1)
gmsh.write("ball.msh")
gmsh.option.setNumber("Mesh.SaveParametric", 0)

# Surface only.
gmsh.clear()
gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
gmsh.model.occ.synchronize()
gmsh.model.mesh.generate(2)
gmsh.option.setNumber("Mesh.Binary", 0)
gmsh.write("surface.msh")

# Hexahedra, and a partitioned mesh.
gmsh.clear()
gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
gmsh.model.occ.synchronize()
for dim, tag in gmsh.model.getEntities(1):
    gmsh.model.mesh.setTransfiniteCurve(tag, 2)
for dim, tag in gmsh.model.getEntities(2):
    gmsh.model.mesh.setTransfiniteSurface(tag)
    gmsh.model.mesh.setRecombine(2, tag)
gmsh.model.mesh.setTransfiniteVolume(1)
gmsh.model.mesh.generate(3)
gmsh.write("hexahedra.msh")
gmsh_model(True)
gmsh.model.mesh.partition(2)
gmsh.write("partitioned.msh")
gmsh.finalize()

# meshio: from Gmsh's file, so that it keeps gmsh:physical.
for stem in ("two", "two-quadratic"):
    mesh = meshio.read(f"{stem}-4.1-ascii.msh")
    mesh.write(f"{stem}-meshio.vtk", binary=True)
    mesh.write(f"{stem}-meshio.vtu", binary=False)
    mesh.write(f"{stem}-meshio-zlib.vtu", binary=True, compression="zlib")
    if stem == "two":
        mesh.write(f"{stem}-meshio-ascii.vtk", binary=False)
        mesh.write(f"{stem}-meshio-2.2.msh", file_format="gmsh22", binary=False)
        # With neither entities nor groups.
        bare = meshio.Mesh(mesh.points, {"tetra": mesh.cells_dict["tetra"]})
        bare.write("bare-meshio-4.1.msh", file_format="gmsh", binary=True)

# VTK's own writers.
for stem in ("two", "two-quadratic"):
    reader = vtk.vtkXMLUnstructuredGridReader()
    reader.SetFileName(f"{stem}-meshio.vtu")
    reader.Update()
    grid = reader.GetOutput()
    grid.GetCellData().GetArray("gmsh:physical").SetName("region")
    for i in reversed(range(grid.GetPointData().GetNumberOfArrays())):
        grid.GetPointData().RemoveArray(i)
    grid.GetCellData().SetActiveScalars("region")
    for version, mode in ((42, "ascii"), (42, "binary"), (51, "ascii"), (51, "binary")):
        writer = vtk.vtkUnstructuredGridWriter()
        writer.SetFileName(f"{stem}-vtk-{version}-{mode}.vtk")
        writer.SetFileVersion(version)
        (writer.SetFileTypeToBinary if mode == "binary" else writer.SetFileTypeToASCII)()
        writer.SetInputData(grid)
        writer.Write()
    for mode, encoded, packed in (("Ascii", 0, 0), ("Binary", 0, 0), ("Binary", 0, 1), ("Appended", 0, 0), ("Appended", 1, 0), ("Appended", 0, 1), ("Appended", 1, 1)):
        if stem != "two" and mode != "Appended":
            continue
        writer = vtk.vtkXMLUnstructuredGridWriter()
        writer.SetFileName(f"{stem}-vtk-{mode.lower()}{'-base64' if encoded else ''}{'-zlib' if packed else ''}.vtu")
        getattr(writer, f"SetDataModeTo{mode}")()
        writer.SetEncodeAppendedData(bool(encoded))
        writer.SetCompressorTypeToZLib() if packed else writer.SetCompressorTypeToNone()
        writer.SetHeaderTypeToUInt64() if packed else writer.SetHeaderTypeToUInt32()
        writer.SetInputData(grid)
        writer.Write()
