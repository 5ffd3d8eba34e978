#pragma once
#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "runtime/roof.hpp"
#include "tools/ecir/bench_timing.hpp"

namespace ecir::cli {

/// An operation at a shape of the shipped networks.
struct OperationRow {
    std::string name;
    std::string shape;
    bool ok = false; ///< the result is within tolerance of the reference; else nothing was timed
    double error = 0;
    Timing time; ///< of all its dispatches, without submitting them
    double gflops = 0;
    double gbs = 0;
    double share = 0; ///< of the roof: that of arithmetic or that of memory, what it is nearer to
};

/// Start-up of a model, measured by runs of `ecir deblur` of their own, start to end.
struct StartTimes {
    double first_run_s = 0;    ///< with empty caches, so that all kernels are compiled
    double second_run_s = 0;   ///< with the caches that it left; median
    double second_start_s = 0; ///< what the second run takes beyond the frame's steady state
    std::string new_size;
    double new_size_s = 0; ///< what a size that the caches have not seen adds to a run
};

/// A whole model: a blurry frame and 100,000 events in host memory to frames in host memory.
struct ModelRow {
    std::string name;
    std::string size;
    uint32_t frames = 0;
    uint32_t refine = 0;
    std::string precision;
    bool ok = false; ///< every value finite, the same from run to run; else nothing was timed
    Timing time;     ///< of a frame by itself
    Timing stream;   ///< from one frame to the next in a stream
    std::optional<StartTimes> start;
};

/// All that `ecir bench` found out.
struct BenchReport {
    Host host;
    DeviceInfo device;
    Precision precision = Precision::float32; ///< of the models; operations have their own
    Roof roof;
    Overhead overhead;
    std::vector<OperationRow> operations;
    std::vector<ModelRow> models;
};

nlohmann::ordered_json to_json(const BenchReport& report);

// The same for a person, on stdout, part by part.
void print_surroundings(const BenchReport& report);
void print_operations(const std::vector<OperationRow>& rows);
void print_models(const std::vector<ModelRow>& rows);

} // namespace ecir::cli
