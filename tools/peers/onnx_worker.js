// A peer in ONNX Runtime: a process that times the network whenever it is told to. Started by bench_peers.
//
// usage: onnx_worker.js CASE FORM MODULES THREADS SECONDS    (FORM-whole.onnx and FORM-STAGE.onnx are read from CASE;
//        MODULES: the node_modules folder with onnxruntime-node)
//
// Writes CASE/onnxruntime-FORM.f32 (the frames), then one JSON line {versions}; for each line read, one JSON line
// {ms, stages} of a turn: a pass that is not counted, then passes for SECONDS, medians. ms is of the whole network as
// one graph; the stages are graphs of their own, run after it.
"use strict";
const fs = require("fs");
const path = require("path");
const readline = require("readline");

const [folder, form, modules, threads, seconds] = process.argv.slice(2);
const ort = require(path.join(modules, "onnxruntime-node"));
const { version } = JSON.parse(fs.readFileSync(path.join(modules, "onnxruntime-node", "package.json")));
const STAGES = ["unet", "curve", "refine"];

function readInputs() {
    const { shapes } = JSON.parse(fs.readFileSync(path.join(folder, "case.json")));
    const read = (name) => {
        const bytes = fs.readFileSync(path.join(folder, `${name}.f32`));
        const values = new Float32Array(bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.length));
        return new ort.Tensor("float32", values, shapes[name]);
    };
    return Object.fromEntries(["blurry", "histogram", "keypoints", "between"].map((name) => [name, read(name)]));
}

function open(name) {
    return ort.InferenceSession.create(path.join(folder, `${form}-${name}.onnx`), {
        executionProviders: ["cpu"],
        executionMode: "sequential",
        graphOptimizationLevel: "all",
        interOpNumThreads: 1,
        intraOpNumThreads: Number(threads),
    });
}

/** Runs a session on what `known` has of its inputs; its outputs join `known`. Returns ms. */
async function run(session, known) {
    const feeds = Object.fromEntries(session.inputNames.map((name) => [name, known[name]]));
    const start = performance.now();
    const outputs = await session.run(feeds);
    const time = performance.now() - start;
    Object.assign(known, outputs);
    return time;
}

function median(values) {
    const sorted = [...values].sort((a, b) => a - b);
    return (sorted[Math.floor((sorted.length - 1) / 2)] + sorted[Math.floor(sorted.length / 2)]) / 2;
}

/** Results of `pass` for the given time, at least one; the first is not counted. */
async function passes(pass) {
    await pass();
    const results = [];
    const start = performance.now();
    do {
        results.push(await pass());
    } while (performance.now() - start < 1000 * Number(seconds));
    return results;
}

async function main() {
    const inputs = readInputs();
    const whole = await open("whole");
    const stages = [];
    for (const name of STAGES) {
        stages.push(await open(name));
    }
    const known = { ...inputs };
    await run(whole, known);
    fs.writeFileSync(path.join(folder, `onnxruntime-${form}.f32`), known.frames.data);
    console.log(JSON.stringify({ versions: `ONNX Runtime ${version}, CPU, node ${process.version}` }));

    for await (const _ of readline.createInterface({ input: process.stdin })) {
        const ms = median(await passes(() => run(whole, known)));
        const parts = await passes(async () => {
            const times = [];
            for (const stage of stages) {
                times.push(await run(stage, known));
            }
            return times;
        });
        const medians = STAGES.map((name, i) => [name, median(parts.map((times) => times[i]))]);
        console.log(JSON.stringify({ ms, stages: Object.fromEntries(medians) }));
    }
}

main().catch((error) => {
    console.error(String(error));
    process.exit(1);
});
