"""A program that idic knows nothing of: a homogeneous strip in tension, in pure Python. Its deck is a list of lines
``NAME value``, then ``time, motion`` of the grip; what it writes are CSV files. FAULT says how it misbehaves where E
lies BETWEEN two values."""

import os
import subprocess
import sys
import time

LENGTH, WIDTH, THICKNESS = 6.0, 4.0, 1.5


def main():
    words, grip = {}, []
    for line in open(sys.argv[1]):
        if "," in line:
            grip.append([float(word) for word in line.split(",")])
        elif line.strip():
            name, value = line.split()
            words[name] = float(value)
    nodes = [line.split() for line in open("nodes.txt")]
    low, high = (float(limit) for limit in os.environ.get("BETWEEN", "0 0").split())
    fault = os.environ.get("FAULT", "") if low < words["E"] < high else ""
    if os.environ.get("COUNT"):
        with open(os.environ["COUNT"], "a") as file:
            file.write(f"{words['E']}\n")
    print("strip: E", words["E"], "fault", fault)
    misbehave(fault)
    frames = grip[1:-1] if fault == "short" else grip[1:]
    with open("displacements.csv", "w") as file:
        file.write("time,node,ux,uy\n")
        for now, motion in frames:
            strain = motion / LENGTH
            for label, x, y in nodes[:-1] if fault == "node" else nodes:
                ux, uy = strain * (float(x) + 0.5 * LENGTH), -words["nu"] * strain * float(y)
                ux = {"nan": float("nan"), "huge": 1e9}.get(fault, ux) if now == grip[-1][0] else ux
                file.write(f"{now!r},{label},{ux!r},{uy!r}\n")
    with open("forces.csv", "w") as file:
        file.write("time,RIGHT.x\n")
        for now, motion in frames:
            file.write(f"{now!r},{words['E'] * motion / LENGTH * WIDTH * THICKNESS!r}\n")


def misbehave(fault):
    if fault == "crash":
        print("*ERROR: the strip has had enough")
        sys.exit(7)
    if fault == "signal":
        os.abort()
    if fault == "hang":
        subprocess.Popen([sys.executable, "-S", "-c", "import time; time.sleep(600)", os.environ["MARK"]])
        time.sleep(600)
    if fault == "chatter":
        for _ in range(200):
            sys.stdout.write("no end of words " * 4000 + "\n")
        sys.exit(1)


if __name__ == "__main__":
    main()
