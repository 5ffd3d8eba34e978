#include "tools/ecir/bench_report.hpp"

#include <cmath>
#include <cstdio>

#include "tools/ecir/precision.hpp"

namespace ecir::cli {
namespace {

using Json = nlohmann::ordered_json;

/// JSON has no infinity.
Json number(double value) {
    return std::isfinite(value) ? Json(value) : Json(nullptr);
}

Json to_json(const Timing& time) {
    return {{"ms", time.median_ms},
            {"spread_ms", time.spread_ms()},
            {"quartiles_ms", {time.first_quartile_ms, time.third_quartile_ms}},
            {"runs", time.runs}};
}

Json to_json(const OperationRow& row) {
    Json json = {{"name", row.name}, {"shape", row.shape}, {"ok", row.ok}};
    json["error"] = number(row.error);
    if (row.ok) {
        json.update(to_json(row.time));
        json["gflops"] = row.gflops;
        json["gbs"] = row.gbs;
        json["share"] = row.share;
    }
    return json;
}

Json to_json(const ModelRow& row) {
    Json json = {{"name", row.name},     {"size", row.size},           {"frames", row.frames},
                 {"refine", row.refine}, {"precision", row.precision}, {"ok", row.ok}};
    if (row.ok) {
        json.update(to_json(row.time));
        json["stream"] = to_json(row.stream);
    }
    if (row.start) {
        json["first_run_s"] = row.start->first_run_s;
        json["second_run_s"] = row.start->second_run_s;
        json["second_start_s"] = row.start->second_start_s;
        json["new_size"] = row.start->new_size;
        json["new_size_s"] = row.start->new_size_s;
    }
    return json;
}

} // namespace

Json to_json(const BenchReport& report) {
    Json json;
    json["host"] = {
        {"cpu", report.host.cpu}, {"cores", report.host.cores}, {"system", report.host.system}};
    json["device"] = report.device.name;
    json["type"] = report.device.type;
    json["driver"] = report.device.driver;
    json["precision"] = precision_name(report.precision);
    json["roof"] = {{"gflops", report.roof.gflops}, {"gbs", report.roof.gbs}};
    json["overhead"] = {{"submit_us", report.overhead.submit_us},
                        {"dispatch_us", report.overhead.dispatch_us}};
    json["ops"] = Json::array();
    for (const OperationRow& row : report.operations) {
        json["ops"].push_back(to_json(row));
    }
    json["models"] = Json::array();
    for (const ModelRow& row : report.models) {
        json["models"].push_back(to_json(row));
    }
    return json;
}

void print_surroundings(const BenchReport& report) {
    std::printf("host       %s, %u cores, %s\n", report.host.cpu.c_str(), report.host.cores,
                report.host.system.c_str());
    std::printf("device     %s (%s), %s\n", report.device.name.c_str(), report.device.type.c_str(),
                report.device.driver.c_str());
    std::printf("precision  %s\n", precision_name(report.precision));
    std::printf("roof       %.1f GFLOP/s of multiply-adds, %.2f GB/s of a copy\n",
                report.roof.gflops, report.roof.gbs);
    std::printf("overhead   %.1f us a submission, %.2f us a dispatch\n", report.overhead.submit_us,
                report.overhead.dispatch_us);
    std::fflush(stdout);
}

void print_operations(const std::vector<OperationRow>& rows) {
    std::printf("\n%-16s %-50s %9s %8s %8s %7s %6s\n", "operation", "shape", "ms", "spread",
                "GFLOP/s", "GB/s", "share");
    for (const OperationRow& row : rows) {
        if (row.ok) {
            std::printf("%-16s %-50s %9.3f %8.3f %8.2f %7.2f %4.0f %%\n", row.name.c_str(),
                        row.shape.c_str(), row.time.median_ms, row.time.spread_ms(), row.gflops,
                        row.gbs, 100 * row.share);
        } else {
            std::printf("%-16s %-50s FAILED: error %.1e\n", row.name.c_str(), row.shape.c_str(),
                        row.error);
        }
    }
    std::fflush(stdout);
}

void print_models(const std::vector<ModelRow>& rows) {
    std::printf("\n%-16s %-9s %6s %6s %9s %9s %8s %9s %8s\n", "model", "size", "frames", "refine",
                "precision", "ms", "spread", "stream", "spread");
    for (const ModelRow& row : rows) {
        std::printf("%-16s %-9s %6u %6u %9s ", row.name.c_str(), row.size.c_str(), row.frames,
                    row.refine, row.precision.c_str());
        if (row.ok) {
            std::printf("%9.2f %8.2f %9.2f %8.2f\n", row.time.median_ms, row.time.spread_ms(),
                        row.stream.median_ms, row.stream.spread_ms());
        } else {
            std::printf("FAILED: not finite, or not the same from run to run\n");
        }
        if (row.start) {
            std::printf("%-16s first run ever %.1f s, second %.2f s of which its start %.2f s, "
                        "a new size (%s) %.2f s more\n",
                        "", row.start->first_run_s, row.start->second_run_s,
                        row.start->second_start_s, row.start->new_size.c_str(),
                        row.start->new_size_s);
        }
    }
    std::fflush(stdout);
}

} // namespace ecir::cli
