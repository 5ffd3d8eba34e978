// A workgroup id below 4096 as lavapipe knows to be the same for all lanes, so that it loads once for all of
// them what lies at addresses made of it: the driver takes any load from the push-constant block for such a
// value. The include needs `uint digit[8]` in that block, holding 0, 1, ..., 7.
uint uniform_id(uint id) {
    return digit[id & 7u] + 8u * digit[(id >> 3) & 7u] + 64u * digit[(id >> 6) & 7u] +
           512u * digit[(id >> 9) & 7u];
}
