#include "host/radio/radio_command.h"

#include <atomic>
#include <csignal>
#include <cstdio>
#include <memory>
#include <string>
#include <utility>

#include "host/radio/radio_faults.h"
#include "host/radio/radio_proxy.h"

namespace ivfm::host {
namespace {

constexpr int kWaitMs = 100;

std::atomic<bool> g_stop{false};
std::atomic<bool> g_end_faults{false};

void on_signal(int signal_number) { (signal_number == SIGUSR1 ? g_end_faults : g_stop) = true; }

int run(const RadioProxyOptions& options) {
  RadioProxy proxy(options);
  struct sigaction action {};
  action.sa_handler = on_signal;
  for (const int signal_number : {SIGINT, SIGTERM, SIGUSR1}) {
    sigaction(signal_number, &action, nullptr);
  }
  std::printf("radio on %s, to %s\n", proxy.listening_on().c_str(), options.to.c_str());
  std::fflush(stdout);
  while (!g_stop) {
    proxy.step(kWaitMs);
    if (g_end_faults.exchange(false)) {
      proxy.end_faults();
      std::printf("radio without faults\n");
      std::fflush(stdout);
    }
  }
  const RadioCounters counters = proxy.counters();
  const auto number = [](std::uint64_t value) { return static_cast<unsigned long long>(value); };
  std::printf(
      "radio: %llu datagrams, %llu lost, %llu duplicated, %llu reordered, %llu spoiled, "
      "%zu senders\n",
      number(counters.sent), number(counters.lost), number(counters.duplicated),
      number(counters.reordered), number(counters.spoiled), proxy.client_count());
  return 0;
}

// One flag a fault: `--drop 0.3` is drop=0.3, `--partition 30s+60s` is partition@30s+60s.
void add_fault_options(CLI::App& command, RadioFaults& faults) {
  const auto take = [&faults](const std::string& flag, const std::string& text) {
    try {
      add_radio_faults(faults, text);
    } catch (const std::invalid_argument& error) {
      throw CLI::ValidationError(flag, error.what());
    }
  };
  const auto add = [&](const std::string& name, char sign, const char* help) {
    command.add_option_function<std::vector<std::string>>(
        "--" + name,
        [take, name, sign](const std::vector<std::string>& values) {
          for (const std::string& value : values) take("--" + name, name + sign + value);
        },
        help);
  };
  command.add_option_function<std::string>(
      "--faults", [take](const std::string& text) { take("--faults", text); },
      "several at once, such as drop=0.3,jitter=200ms,partition@30s+60s");
  add("drop", '=', "probability 0 .. 1 that a datagram is lost");
  add("duplicate", '=', "that it arrives twice");
  add("reorder", '=', "that it is held back for up to 500 ms, so that later ones overtake it");
  add("corrupt", '=', "that one of its bits is flipped");
  add("truncate", '=', "that its end is missing");
  add("delay", '=', "of every datagram, such as 20ms");
  add("jitter", '=', "and up to this much more");
  add("rate", '=', "bytes per second and direction, IP and UDP headers included");
  add("partition", '@', "BEGIN[+LENGTH], such as 30s+60s: nothing gets through; repeatable");
}

}  // namespace

void add_radio_command(CLI::App& app, CommandAction& action) {
  CLI::App* command =
      app.add_subcommand("radio", "A bad radio between robots and map server (UDP proxy)");
  auto options = std::make_shared<RadioProxyOptions>();
  command->add_option("--listen", options->listen, "HOST:PORT for the robots; port 0: a free one")
      ->capture_default_str();
  command->add_option("--to", options->to, "HOST:PORT of the map server")->capture_default_str();
  add_fault_options(*command, options->faults);
  command->add_option("--seed", options->seed, "of everything random")->capture_default_str();
  command->add_option("--time-scale", options->time_scale, "times faster than the wall clock")
      ->check(CLI::Range(0.01, 1000.0))
      ->capture_default_str();
  command->footer(
      "SIGUSR1 ends all faults.\nExample: ivfm radio --drop 0.3 --duplicate 0.1 --jitter 200ms "
      "--partition 30s+60s --listen 0.0.0.0:7701 --to 127.0.0.1:7700");
  command->callback([options, &action] { action = [options] { return run(*options); }; });
}

}  // namespace ivfm::host
