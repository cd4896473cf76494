#include "firmware/lidar/rplidar_decoder.h"
#include "tests/fuzz/fuzz_input.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace ivfm;
  RplidarDecoder decoder;
  for (const std::uint8_t byte : std::span(data, size)) {
    if (decoder.process(byte) != RplidarDecoder::Event::kSamples) continue;
    fuzz::require(!decoder.samples().empty() && decoder.samples().size() <= 32,
                  "1 .. 32 samples an event");
  }
  return 0;
}
