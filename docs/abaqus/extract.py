"""Motion of all nodes and force on the set RIGHT of an odb, as csv: `abaqus python extract.py JOB`, Python 2.7 or 3."""

import csv
import sys

from odbAccess import openOdb

odb = openOdb(sys.argv[1] + ".odb", readOnly=True)
assembly = odb.rootAssembly
(instance,) = assembly.instances.values()
owner = assembly if assembly.nodeSets.has_key("RIGHT") else instance
right = owner.nodeSets["RIGHT"].nodes
grip = {node.label for node in (right[0] if owner is assembly else right)}
with open("displacements.csv", "w") as motion_file, open("forces.csv", "w") as force_file:
    motion, force = csv.writer(motion_file), csv.writer(force_file)
    motion.writerow(["time", "node", "ux", "uy"])
    force.writerow(["time", "RIGHT.x"])
    for step in odb.steps.values():
        for frame in step.frames:
            time, fields = step.totalTime + frame.frameValue, frame.fieldOutputs
            motion.writerows([time, value.nodeLabel, value.data[0], value.data[1]] for value in fields["U"].values)
            force.writerow([time, sum(value.data[0] for value in fields["RF"].values if value.nodeLabel in grip)])
