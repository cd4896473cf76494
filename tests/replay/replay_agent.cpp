// `replay_agent FILE MODEL [--each | --count]`: plays a replay file and prints the hash of all that
// the core decided and sent. --each: also one line a decision. --count: also how much virtual time
// it took, which is one nanosecond an instruction on an emulated AArch64 machine with `-icount
// shift=0`. Core and C library only.
#include <array>
#include <cerrno>
#include <cinttypes>
#include <cstdio>
#include <cstring>
#include <new>

#include "firmware/nn/q_network.h"
#include "tests/replay/replay_player.h"

namespace ivfm::replay {
namespace {

class FileSource final : public ByteSource {
 public:
  explicit FileSource(std::FILE* file) : file_(file) {}
  std::size_t read(std::span<std::uint8_t> out) override {
    return std::fread(out.data(), 1, out.size(), file_);
  }

 private:
  std::FILE* file_;
};

class DecisionPrinter final : public DecisionListener {
 public:
  void on_decision(const DecisionReport& report) override {
    std::printf("%4" PRIu32 " %10" PRIu64 " ms kind %d goal %6" PRId32 " %6" PRId32
                " hash %016" PRIx64 "\n",
                report.number, report.now_us / 1000, static_cast<int>(report.decision.kind),
                report.decision.goal.x, report.decision.goal.y, report.hash);
  }
};

#ifdef __aarch64__
// The generic timer: nanoseconds since the machine started.
class VirtualTime final : public WorkCounter {
 public:
  std::uint64_t now() override {
    std::uint64_t ticks, hertz;
    asm volatile("isb\n mrs %0, cntvct_el0" : "=r"(ticks)::"memory");
    asm volatile("mrs %0, cntfrq_el0" : "=r"(hertz));
    return ticks * (1'000'000'000 / hertz);
  }
};
WorkCounter* virtual_time() {
  static VirtualTime counter;
  return &counter;
}
#else
WorkCounter* virtual_time() { return nullptr; }  // no such machine
#endif

struct Options {
  bool each = false;
  bool count = false;
};

void print_work(const char* what, const WorkStatistics& work) {
  const std::uint64_t mean = work.count == 0 ? 0 : work.total / work.count;
  std::printf("ns of %s: %" PRIu32 ", mean %" PRIu64 ", largest %" PRIu64 "\n", what, work.count,
              mean, work.largest);
}

// A fixed place for the profile's object, as on a robot.
template <typename T, typename... Arguments>
T& place(Arguments&&... arguments) {
  alignas(T) static unsigned char storage[sizeof(T)];
  return *new (storage) T(arguments...);
}

template <typename Profile>
Status play(ReplayReader& reader, const Header& header, std::span<const std::uint8_t> model,
            DecisionListener* listener, WorkCounter* counter, ReplaySummary& summary) {
  if (header.subject == Subject::kExplorer) {
    auto& explorer = place<ExplorerFor<Profile>>(header.config.explorer);
    auto& network = place<QNetwork>();
    const ModelStatus loaded = network.load(model);
    if (!ok(loaded.status)) return loaded.status;
    return replay_explorer(reader, explorer, network, listener, summary);
  }
  AgentReplay player(reader, counter);
  auto& agent = place<AgentFor<Profile>>(header.config, player.ports());
  const ModelStatus loaded = agent.load_model(model);
  if (!ok(loaded.status)) return loaded.status;
  return player.run(agent, listener, summary);
}

Status play_profile(ReplayReader& reader, const Header& header, std::span<const std::uint8_t> model,
                    DecisionListener* listener, WorkCounter* counter, ReplaySummary& summary) {
  switch (header.profile) {
    case ProfileId::kPaper:
      return play<PaperProfile>(reader, header, model, listener, counter, summary);
    case ProfileId::kRobot:
      return play<RobotProfile>(reader, header, model, listener, counter, summary);
    case ProfileId::kMcu:
      return play<McuProfile>(reader, header, model, listener, counter, summary);
  }
  return Status::kUnsupported;
}

int fail(const char* what, const char* path, const char* why) {
  std::fprintf(stderr, "replay_agent: %s %s: %s\n", what, path, why);
  return 1;
}

int run(const char* replay_path, const char* model_path, const Options& options) {
  alignas(64) static std::array<std::uint8_t, kMaxModelBytes> model;
  std::FILE* model_file = std::fopen(model_path, "rb");
  if (model_file == nullptr) return fail("cannot read", model_path, std::strerror(errno));
  const std::size_t model_size = std::fread(model.data(), 1, model.size(), model_file);
  std::fclose(model_file);
  std::FILE* file = std::fopen(replay_path, "rb");
  if (file == nullptr) return fail("cannot read", replay_path, std::strerror(errno));

  FileSource source(file);
  ReplayReader reader(source);
  Header header;
  ReplaySummary summary;
  DecisionPrinter printer;
  Status status = reader.read_header(header);
  if (ok(status)) {
    status = play_profile(reader, header, std::span(model).first(model_size),
                          options.each ? &printer : nullptr,
                          options.count ? virtual_time() : nullptr, summary);
  }
  std::fclose(file);
  if (!ok(status)) return fail("cannot play", replay_path, to_string(status));
  std::printf("%" PRIu32 " decisions, %" PRIu32 " local goals, %" PRIu32 " scans, %" PRIu32
              " steps, %" PRIu32 " frames sent, %" PRIu32 " steps with unread input\n",
              summary.decisions, summary.local_goals, summary.scans, summary.steps,
              summary.frames_sent, summary.unused_steps);
  if (options.count && virtual_time() != nullptr) {
    print_work("decisions", summary.decision_work);
    print_work("fusing a revolution", summary.fusion_work);
    print_work("steps that fuse a revolution", summary.scan_work);
    print_work("other steps", summary.step_work);
    print_work("revolutions", summary.revolution_work);
  }
  std::printf("hash %016" PRIx64 "\n", summary.hash);
  return 0;
}

}  // namespace
}  // namespace ivfm::replay

int main(int argc, char** argv) {
  ivfm::replay::Options options;
  options.each = argc == 4 && std::strcmp(argv[3], "--each") == 0;
  options.count = argc == 4 && std::strcmp(argv[3], "--count") == 0;
  if (argc != 3 && !options.each && !options.count) {
    std::fputs("usage: replay_agent FILE MODEL [--each | --count]\n", stderr);
    return 2;
  }
  return ivfm::replay::run(argv[1], argv[2], options);
}
