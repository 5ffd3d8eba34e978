#pragma once
#include <atomic>
#include <memory>
#include <thread>
#include <vector>

namespace ecir {

class Device;
class Kernel;

/// Has a CPU driver compile kernels that no run has used yet on one more processor. lavapipe
/// generates machine code when a kernel is first dispatched, on the one thread that executes the
/// queue, and keeps it on disk. So another logical device dispatches the kernels, last first and
/// without workgroups, while the first device goes through them from the first: what either has
/// compiled the other one finds on disk. The first run ever on the sample takes 16.5 instead
/// of 24.4 s on two cores. Only saves time: errors are swallowed.
class CompileAhead {
public:
    /// Begins; `kernels`, of `device`, in the order in which it will dispatch them. The device must
    /// outlive this.
    CompileAhead(const Device& device, const std::vector<const Kernel*>& kernels);
    /// Waits for all kernels, after end() for the one at hand.
    ~CompileAhead();
    CompileAhead(const CompileAhead&) = delete;
    CompileAhead& operator=(const CompileAhead&) = delete;

    /// Leaves out the kernels that are left.
    void end() { ends_ = true; }

private:
    std::atomic<bool> ends_ = false;
    std::thread thread_;
};

} // namespace ecir
