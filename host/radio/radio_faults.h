// How the faults of a radio are written on the command line.
#pragma once

#include <string_view>

#include "firmware/hal/fake/faulty_channel.h"

namespace ivfm::host {

// Adds faults to `faults`, separated by commas: drop=P, duplicate=P, reorder=P, corrupt=P or
// truncate=P with a probability 0 .. 1; delay=T or jitter=T with a time such as 20ms; rate=N in
// bytes per second; partition@BEGIN[+LENGTH] with times such as 30s (without a length: to the end).
// Throws std::invalid_argument with a sentence that quotes the text and says what is allowed.
void add_radio_faults(RadioFaults& faults, std::string_view text);

}  // namespace ivfm::host
