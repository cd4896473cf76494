#include "firmware/wheel_drive/wheel_drive.h"
#include "tests/fuzz/fuzz_input.h"

namespace ivfm {
namespace {

// Frames from the fuzzer's bytes: identifier in 2, size, data. Size 9 and above: time passes.
class FuzzedBus final : public CanBus {
 public:
  explicit FuzzedBus(fuzz::Input& input) : input_(input) {}
  Result<CanFrame> receive() override {
    if (input_.empty()) return Status::kEmpty;
    CanFrame frame;
    frame.id = static_cast<std::uint16_t>((input_.byte() | input_.byte() << 8) & 0x7ff);
    frame.size = input_.byte();
    if (frame.size > 8) return Status::kEmpty;
    for (std::size_t i = 0; i < frame.size; ++i) frame.data[i] = input_.byte();
    return frame;
  }
  Status send(const CanFrame& frame) override {
    fuzz::require(frame.id <= 0x7ff && frame.size <= 8, "frames are classic ones");
    return Status::kOk;
  }

 private:
  fuzz::Input& input_;
};

}  // namespace
}  // namespace ivfm

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace ivfm;
  fuzz::Input input(data, size);
  FuzzedBus bus(input);
  WheelDrive wheels({}, bus);
  TimeUs now_us = 1;
  while (!input.empty()) {
    wheels.set_velocity({100'000, 500});
    wheels.step(now_us += 10'000);
  }
  return 0;
}
