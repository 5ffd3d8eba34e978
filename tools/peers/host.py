"""The machine: what it is, and how much of its chosen cores others used meanwhile."""
import os
import resource


def cpu_name():
    with open("/proc/cpuinfo", encoding="utf-8") as file:
        names = [line.split(":", 1)[1].strip() for line in file if line.startswith("model name")]
    return names[0] if names else "CPU of unknown name"


def keep_to_cores(count):
    """Restricts this process and those it starts to `count` cores; returns them."""
    cores = sorted(os.sched_getaffinity(0))[:count]
    os.sched_setaffinity(0, cores)
    return cores


def _busy(cores):
    """Seconds that the cores have worked or waited for a hypervisor, since boot."""
    names, seconds = {f"cpu{core}" for core in cores}, 0.0
    with open("/proc/stat", encoding="ascii") as file:
        for line in file:
            name, *ticks = line.split()
            if name in names:
                user, nice, system, _idle, _iowait, irq, softirq, steal = map(int, ticks[:8])
                seconds += (user + nice + system + irq + softirq + steal) / os.sysconf("SC_CLK_TCK")
    return seconds


def _own(processes):
    """Seconds of CPU time of this process, of those that it started and that ended, and of `processes`."""
    seconds = 0.0
    for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN):
        usage = resource.getrusage(who)
        seconds += usage.ru_utime + usage.ru_stime
    for process in processes:
        with open(f"/proc/{process}/stat", encoding="utf-8") as file:
            fields = file.read().rsplit(")", 1)[1].split()
        seconds += (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    return seconds


class Load:
    """From its making to share(): what others used of the cores, as a share of their time."""

    def __init__(self, cores, processes):
        self.cores, self.processes, self.clock = cores, processes, os.times().elapsed
        self.busy, self.own = _busy(cores), _own(processes)

    def share(self):
        seconds = os.times().elapsed - self.clock
        others = (_busy(self.cores) - self.busy) - (_own(self.processes) - self.own)
        return max(0.0, others / (seconds * len(self.cores)))
