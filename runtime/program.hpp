#pragma once
#include <array>
#include <cstring>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "runtime/arena.hpp"
#include "runtime/buffer.hpp"
#include "runtime/device.hpp"
#include "runtime/kernel.hpp"
#include "runtime/tensor.hpp"

namespace ecir {

class CompileAhead;

enum class Access { read, write, update };

/// One argument of a kernel: a tensor, or a buffer that several programs share (weights).
struct Argument {
    Tensor tensor;
    std::shared_ptr<const Buffer> buffer;
    uint64_t offset = 0; ///< of a buffer: where the kernel's view of it starts
    Access access = Access::read;
};
inline Argument read(const Tensor& tensor) {
    return {tensor, {}, 0, Access::read};
}
inline Argument write(const Tensor& tensor) {
    return {tensor, {}, 0, Access::write};
}
inline Argument update(const Tensor& tensor) {
    return {tensor, {}, 0, Access::update};
}
inline Argument constant(std::shared_ptr<const Buffer> buffer, uint64_t offset = 0) {
    return {{}, std::move(buffer), offset, Access::read};
}

/// One launch of a kernel.
struct Dispatch {
    const Kernel* kernel = nullptr;
    std::vector<Argument> arguments; ///< binding 0, 1, ...
    /// Arguments read through device addresses: the address is written into the push constants at
    /// byte `push_offset` when the program is recorded.
    struct Pointer {
        uint32_t push_offset = 0;
        Argument argument;
        uint64_t byte_offset = 0;
    };
    std::vector<Pointer> pointers;
    std::vector<std::byte> push;
    std::array<uint32_t, 3> groups{1, 1, 1};
    double flops = 0; ///< arithmetic operations, for splitting long work and for bench
    double bytes = 0; ///< memory traffic at the least
    std::string label;

    template <typename T> void set_push(const T& constants) {
        static_assert(std::is_trivially_copyable_v<T>);
        push.resize(sizeof(T));
        std::memcpy(push.data(), &constants, sizeof(T));
    }
};

/// Time of one dispatch of a profiled run.
struct DispatchTime {
    std::string label;
    double ms = 0;
    double flops = 0;
    double bytes = 0;
};

/// Work recorded once for a shape and replayed for each frame.
///
/// Steps that touch the same bytes, at least one of them writing, run in the order in which they
/// were added. All others need not: each step runs in the first level in which what it waits for is
/// done, and barriers stand between levels only. So work that goes on side by side (several frames,
/// each with tensors of its own) keeps a GPU full, however it was added. Tensors live in one arena
/// whose offsets are planned from lifetimes (the first and the last level that touches them); long
/// work is split into several submissions.
///
/// Inputs and outputs go through staging memory. A second set of it, made when it is first needed,
/// lets the host write the next run's inputs and read the last one's outputs while the device works
/// on the one between. On a device with a second queue that set has an arena of its own, so both
/// runs go on at once: one fills the device where the other has too little work for it. Else the
/// device takes the runs in turn.
class Program {
public:
    explicit Program(Device& device);
    /// Waits for runs that nobody has waited for.
    ~Program();
    Program(const Program&) = delete;
    Program& operator=(const Program&) = delete;

    /// A tensor that the host writes before a run. Its content stays for the runs after it as long
    /// as each run is waited for before the next one is written.
    Tensor input(const Layout& layout);
    /// A tensor that the host reads after a run.
    Tensor output(const Layout& layout);
    /// A tensor between steps; its memory is shared with others that live at other times.
    Tensor temporary(const Layout& layout);
    /// A temporary that is all zeros until a step writes it, in each run: with a halo that is read
    /// and never written.
    Tensor cleared(const Layout& layout);

    /// Throws Error(resources) naming the kernel for more workgroups than the device launches.
    void add(Dispatch dispatch);
    /// Fills a whole tensor with zeros.
    void clear(const Tensor& tensor);
    /// What `record` adds runs only where the first word of `flag` is not 0 when the device comes
    /// to it, else tensors stay as they are; the host has no part in that. Throws Error(device) for
    /// a clear() or another when() in it: the device cannot leave these out.
    void when(const Tensor& flag, const std::function<void()>& record);

    /// Plans the memory and records. Throws Error(resources) with both figures when the arena, or
    /// one tensor, is more than the device has; nothing has run by then.
    void finish();

    /// Whether the next run's inputs can be written: false while two runs are submitted, or one
    /// where the device has no memory for a second set of staging; wait() then makes room.
    [[nodiscard]] bool reserve();
    /// Data of an input: dense channels x height x width (or a shorter prefix of it).
    void write(const Tensor& input, std::span<const std::byte> data);
    template <typename T> void write(const Tensor& input, std::span<const T> values) {
        static_assert(sizeof(T) == 4);
        write(input, std::as_bytes(values));
    }
    template <typename T> void write(const Tensor& input, const std::vector<T>& values) {
        write(input, std::span<const T>(values));
    }

    /// Starts a run with what was written; reserve() must have been true.
    void submit();
    /// Waits for the oldest run submitted; read() then gives what that one made, until the next
    /// submit().
    void wait();
    /// submit() and wait().
    void run();
    /// Runs once with a timestamp around every dispatch; times in the order in which steps were
    /// added. Those that run side by side have their common time, in shares that mean nothing.
    std::vector<DispatchTime> profile();

    /// The raw memory of an output after wait(), as its layout orders it.
    [[nodiscard]] std::span<const float> read(const Tensor& output) const;

    [[nodiscard]] Device& device() const { return device_; }
    [[nodiscard]] uint64_t arena_bytes() const { return arena_bytes_; }
    /// Floating-point operations of all dispatches.
    [[nodiscard]] double flops() const;
    [[nodiscard]] size_t steps() const { return steps_.size(); }
    [[nodiscard]] size_t barriers() const { return barriers_; }
    [[nodiscard]] size_t submissions() const { return staging_.front().recording.commands.size(); }

private:
    enum class Kind { input, output, temporary };
    struct Slot {
        Kind kind = Kind::temporary;
        uint64_t bytes = 0;
        uint32_t first = UINT32_MAX; ///< level that touches it
        uint32_t last = 0;
        uint64_t offset = 0;         ///< in the arena
        uint64_t staging_offset = 0; ///< in the upload or readback buffer
    };
    struct Step {
        Dispatch dispatch;
        bool clear = false;
        std::optional<Tensor> launch{}; ///< workgroup counts on the device, in place of groups
    };
    struct Range {
        VkBuffer buffer;
        uint64_t begin;
        uint64_t end;
    };
    /// What runs work on that cannot be under way at one time.
    struct Memory {
        Buffer arena;
        Handle<VkDescriptorPool> pool;
        std::vector<VkDescriptorSet> sets;          ///< by step
        std::vector<std::vector<uint32_t>> dynamic; ///< uniform offsets by step
    };
    struct Recording {
        Handle<VkCommandPool> pool;
        std::vector<VkCommandBuffer> commands;
    };
    struct Staging {
        Buffer upload;
        Buffer readback;
        std::shared_ptr<const Memory> memory;
        uint32_t queue = 0;
        Recording recording; ///< with copies from and to these buffers
        Handle<VkFence> fence;
    };
    static constexpr size_t kMostStaging = 2;

    Tensor make(Kind kind, const Layout& layout);
    void order();
    void plan();
    void compile_ahead();
    [[nodiscard]] std::shared_ptr<const Memory> make_memory() const;
    /// Another set of staging, `apart` with memory and a queue of its own; false where the device
    /// has none to give.
    bool add_staging(bool apart);
    Staging make_staging(std::shared_ptr<const Memory> memory, uint32_t queue);
    Recording record(const Staging& staging, VkQueryPool queries);
    void record_step(VkCommandBuffer commands, const Memory& memory, size_t index);
    [[nodiscard]] Range range(const Memory& memory, const Argument& argument) const;
    /// What it touches in the arena.
    [[nodiscard]] static std::vector<Argument> tensors(const Step& step);
    [[nodiscard]] uint64_t address(const Memory& memory, const Dispatch::Pointer& pointer) const;

    Device& device_;
    std::vector<Slot> slots_;
    std::vector<Step> steps_;
    std::vector<uint32_t> levels_; ///< by step, ascending
    std::vector<size_t> added_;    ///< by step its place in the order in which steps were added
    bool conditional_ = false;     ///< inside of when()
    uint64_t arena_bytes_ = 0;
    uint64_t upload_bytes_ = 0;
    uint64_t readback_bytes_ = 0;
    size_t barriers_ = 0;
    std::vector<Staging> staging_;
    std::vector<size_t> running_; ///< sets of staging whose runs are submitted, oldest first
    size_t written_ = 0;          ///< the set that write() fills
    size_t read_ = 0;             ///< the set that read() reads
    std::unique_ptr<CompileAhead> ahead_; ///< ends with the first run
};

} // namespace ecir
