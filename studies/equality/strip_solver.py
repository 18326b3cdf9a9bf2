"""A solver that idic knows nothing of: a plain strip in tension, in pure Python.

Its deck is a list of lines ``NAME value``, then lines ``time, motion`` of the grip; it writes CSV files.
"""

import sys

LENGTH, WIDTH, THICKNESS = 6.0, 4.0, 1.5


def main(deck):
    words, grip = {}, []
    with open(deck) as lines:
        for line in lines:
            if "," in line:
                grip.append([float(word) for word in line.split(",")])
            elif line.strip():
                name, value = line.split()
                words[name] = float(value)
    with open("nodes.txt") as lines:
        nodes = [line.split() for line in lines]
    with open("displacements.csv", "w") as file:
        file.write("time,node,ux,uy\n")
        for now, motion in grip[1:]:
            strain = motion / LENGTH
            for label, x, y in nodes:
                ux, uy = strain * (float(x) + 0.5 * LENGTH), -words["nu"] * strain * float(y)
                file.write(f"{now!r},{label},{ux!r},{uy!r}\n")
    with open("forces.csv", "w") as file:
        file.write("time,RIGHT.x\n")
        for now, motion in grip[1:]:
            file.write(f"{now!r},{words['E'] * motion / LENGTH * WIDTH * THICKNESS!r}\n")


if __name__ == "__main__":
    main(sys.argv[1])
