// The agent of the `mcu` profile on a bare Cortex-M7: plays a recording through semihosting, prints
// the hash of all that it decided and sent, the instructions it took, and the stack it needed.
// Command line: FILE [--each]
#include <array>
#include <cstring>
#include <new>

#include "firmware/hal/cortex_m/semihosting.h"
#include "firmware/hal/cortex_m/stack.h"
#include "tests/replay/replay_player.h"

// The model, in flash.
asm(".section .model, \"a\"\n"
    ".balign 64\n"
    ".global ivfm_model_begin\nivfm_model_begin:\n"
    ".incbin \"" IVFM_MODEL_FILE
    "\"\n"
    ".global ivfm_model_end\nivfm_model_end:\n"
    ".balign 4\n.text\n");
extern "C" const std::uint8_t ivfm_model_begin[], ivfm_model_end[];

namespace ivfm::replay {
namespace {

using semihosting::print;
using semihosting::print_hex;
using semihosting::print_unsigned;

class SemihostedFile final : public ByteSource {
 public:
  explicit SemihostedFile(std::int32_t file) : file_(file) {}
  std::size_t read(std::span<std::uint8_t> out) override { return semihosting::read(file_, out); }

 private:
  std::int32_t file_;
};

// The board's counter of 25 MHz. Under `qemu -icount shift=0` an instruction takes 1 ns, so this
// counts in steps of 40 instructions.
class InstructionCounter final : public WorkCounter {
 public:
  std::uint64_t now() override {
    const std::uint32_t ticks = *reinterpret_cast<volatile std::uint32_t*>(kCounter);
    total_ += ticks - last_;  // wraps after 171 s
    last_ = ticks;
    return total_ * 40;
  }

 private:
  static constexpr std::uintptr_t kCounter = 0x40028018;  // FPGAIO COUNTER (Arm AN500)
  std::uint32_t last_ = 0;
  std::uint64_t total_ = 0;
};

class DecisionPrinter final : public DecisionListener {
 public:
  void on_decision(const DecisionReport& report) override {
    print_unsigned(report.number);
    print(" hash ");
    print_hex(report.hash);
    print(" instructions ");
    print_unsigned(report.work);
    print("\n");
  }
};

void print_work(const char* what, const WorkStatistics& work) {
  print(what);
  print(": ");
  print_unsigned(work.count);
  print(", mean ");
  print_unsigned(work.count == 0 ? 0 : work.total / work.count);
  print(", largest ");
  print_unsigned(work.largest);
  print("\n");
}

void print_summary(const ReplaySummary& summary) {
  print_unsigned(summary.decisions);
  print(" decisions, ");
  print_unsigned(summary.local_goals);
  print(" local goals, ");
  print_unsigned(summary.scans);
  print(" scans, ");
  print_unsigned(summary.steps);
  print(" steps\n");
  print_work("instructions of decisions", summary.decision_work);
  print_work("instructions of fusing a revolution", summary.fusion_work);
  print_work("instructions of steps that fuse a revolution", summary.scan_work);
  print_work("instructions of other steps", summary.step_work);
  print_work("instructions of revolutions without a decision", summary.revolution_work);
  print("bytes of stack used ");
  print_unsigned(stack_used());
  print(" of ");
  print_unsigned(stack_size());
  print("\nhash ");
  print_hex(summary.hash);
  print("\n");
}

// All of the program's memory but the stack.
struct Everything {
  explicit Everything(std::int32_t file) : source(file) {}
  SemihostedFile source;
  ReplayReader reader{source};
  Header header;
  InstructionCounter counter;
  AgentReplay player{reader, &counter};
  ReplaySummary summary;
  DecisionPrinter printer;
};

alignas(Everything) unsigned char everything_memory[sizeof(Everything)];
alignas(AgentFor<McuProfile>) unsigned char agent_memory[sizeof(AgentFor<McuProfile>)];

int fail(const char* why) {
  print("replay: ");
  print(why);
  print("\n");
  return 1;
}

int run(const char* path, bool each) {
  const std::int32_t file = semihosting::open_for_reading(path);
  if (file < 0) return fail("cannot open the recording");
  auto& all = *new (everything_memory) Everything(file);
  const Status status = all.reader.read_header(all.header);
  if (!ok(status)) return fail(to_string(status));
  if (all.header.subject != Subject::kAgent || all.header.profile != ProfileId::kMcu) {
    return fail("not a recording of the mcu profile");
  }
  auto& agent = *new (agent_memory) AgentFor<McuProfile>(all.header.config, all.player.ports());
  const ModelStatus loaded = agent.load_model(
      {ivfm_model_begin, static_cast<std::size_t>(ivfm_model_end - ivfm_model_begin)});
  if (!ok(loaded.status)) return fail(loaded.reason);
  const Status played = all.player.run(agent, each ? &all.printer : nullptr, all.summary);
  if (!ok(played)) return fail(to_string(played));
  print_summary(all.summary);
  return 0;
}

}  // namespace
}  // namespace ivfm::replay

int main() {
  std::array<char, 128> line{};
  ivfm::semihosting::command_line(line);
  char* const each = std::strstr(line.data(), " --each");
  if (each != nullptr) *each = 0;
  return ivfm::replay::run(line.data(), each != nullptr);
}
