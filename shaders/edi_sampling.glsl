// Where event thresholds are tested. C++ reads this file too: layers/edi_moments.cpp checks the
// numbers against those of the host.

// Windows of time, in 256ths from the exposure's start at 0 to its end at 512.
const uint WINDOWS = 16;
const uint WINDOW_FIRST = 11;   // start of the first
const uint WINDOW_SPACING = 32; // from one start to the next
const uint WINDOW_LENGTH = 10;
const uint STEP = 3;    // pixels from one sample to the next
const uint SAMPLES = 8; // a side of a tile
const uint RUN = 4;     // samples an invocation of edi_filter.comp
