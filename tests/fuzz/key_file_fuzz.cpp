#include <stdexcept>
#include <string>

#include "firmware/hal/linux/radio_key_file.h"
#include "tests/fuzz/fuzz_input.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace ivfm;
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  try {
    const RadioKeys keys = parse_radio_keys(text, "file");
    fuzz::require(!keys.empty() && !keys.contains(0), "keys belong to robots");
    fuzz::require(parse_radio_keys(format_radio_keys(keys), "file") == keys,
                  "what can be read can be written");
  } catch (const std::runtime_error&) {
  }
  return 0;
}
