#include "host/map_server/serve_command.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <csignal>
#include <iomanip>
#include <iostream>
#include <map>
#include <memory>
#include <optional>
#include <sstream>
#include <stdexcept>

#include "firmware/hal/linux/random_boot.h"
#include "host/cli/progress_line.h"
#include "host/cli/shipped_model.h"
#include "host/dashboard/live_page.h"
#include "host/dashboard/live_state.h"
#include "host/map_server/key_ring.h"
#include "host/map_server/map_server.h"
#include "host/map_server/run_database.h"
#include "host/map_server/server_metrics.h"
#include "host/map_server/udp_listener.h"

namespace ivfm::host {
namespace {

constexpr int kMaxDatagramsPerTurn = 1000;
constexpr TimeUs kStepsPerCommit = 20;

std::atomic<bool> stop_requested{false};
static_assert(std::atomic<bool>::is_always_lock_free);

void request_stop(int) { stop_requested = true; }

std::int64_t unix_time_us() {
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  return std::chrono::duration_cast<std::chrono::microseconds>(now).count();
}

// The run's time: goes on where the last session ended, `scale` times as fast as the wall clock.
class RunClock {
 public:
  RunClock(std::int64_t start_us, double scale)
      : start_us_(static_cast<double>(start_us)), scale_(scale) {}
  TimeUs now_us() const {
    const std::chrono::duration<double, std::micro> elapsed =
        std::chrono::steady_clock::now() - begin_;
    return static_cast<TimeUs>(start_us_ + elapsed.count() * scale_) + 1;
  }

 private:
  std::chrono::steady_clock::time_point begin_ = std::chrono::steady_clock::now();
  double start_us_;
  double scale_;
};

std::string kib(std::uint64_t bytes) {
  std::ostringstream text;
  text << std::fixed << std::setprecision(1) << static_cast<double>(bytes) / 1024.0 << " KiB";
  return text.str();
}

std::string summary(const MapServer& server, TimeUs now_us) {
  const MapServerCounters& counters = server.counters();
  std::ostringstream text;
  text << std::fixed << std::setprecision(1) << static_cast<double>(now_us) / 1e6 << " s  "
       << server.robot_count() << (server.robot_count() == 1 ? " robot  " : " robots  ")
       << server.map().explored_cells() << " cells explored  in " << kib(counters.traffic.bytes_in)
       << "  out " << kib(counters.traffic.bytes_out) << "  dropped " << counters.dropped();
  for (const auto& [robot, map] : server.apart_maps()) text << "  robot " << robot << " apart";
  return text.str();
}

void receive_all(UdpListener& listener, MapServer& server, TimeUs now_us) {
  // One byte more than a datagram may have, so that a longer one is seen to be too long.
  std::array<std::uint8_t, kMaxDatagramBytes + 1> buffer;
  for (int i = 0; i < kMaxDatagramsPerTurn; ++i) {
    const auto datagram = listener.receive(buffer);
    if (!datagram) return;
    server.receive(datagram->second, std::span(buffer).first(datagram->first), now_us);
  }
}

// For the page's Q map; empty: there is none.
std::string model_of(const ServeOptions& options) {
  if (!options.model.empty()) return options.model;
  try {
    return shipped_model(".ivfm").string();
  } catch (const std::runtime_error&) {
    return {};
  }
}

// The live page of a run: shows what the server holds, and passes on what people ask for.
class LiveView {
 public:
  LiveView(const ServeOptions& options, const MapServer& server)
      : local_(model_of(options), options.visit_range_m),
        state_(random_token()),
        page_(options.http, state_, random_token()) {
    page_.set_local_view(local_);
    state_.set_explorable(options.explorable_m2);
    if (server.robot_count() > 0) state_.restore(options.database);
  }
  std::string link() const { return page_.url_with_token(); }

  // Ten times a second the map, once a second the metrics, whatever the time scale.
  void update(MapServer& server, const RunDatabase& database, TimeUs now_us) {
    for (const PageCommand& command : page_.take_commands()) {
      if (command.robot) {
        server.send_command(*command.robot, command.code);
      } else {
        server.send_command_to_all(command.code);
      }
    }
    const auto now = std::chrono::steady_clock::now();
    if (now < next_) return;
    next_ = now + std::chrono::milliseconds(100);
    state_.update(server, now_us);
    if (now < next_metrics_) return;
    next_metrics_ = now + std::chrono::seconds(1);
    page_.set_metrics(
        prometheus_text(server, database.commit_times(), now_us, database.file_bytes()));
  }

 private:
  LocalView local_;
  LiveState state_;
  LivePage page_;
  std::chrono::steady_clock::time_point next_{}, next_metrics_{};
};

}  // namespace

void serve(const ServeOptions& options, const std::atomic<bool>& stop, std::ostream& out) {
  std::optional<KeyRing> keys;
  if (!options.keys.empty()) keys.emplace(read_radio_keys(options.keys));
  UdpListener listener(options.listen);
  if (!keys && !listener.is_loopback()) {
    throw std::runtime_error("--listen " + options.listen +
                             " is open to other machines, so it needs --keys FILE; "
                             "ivfm keygen writes one");
  }
  RunDatabase database(options.database);
  const std::uint32_t epoch = database.begin_session(unix_time_us(), options.time_scale);
  const RunClock clock(database.last_time_us(), options.time_scale);
  MapServerConfig config;
  config.retention_us = static_cast<TimeUs>(options.retention_s * 1e6);
  config.boot = draw_boot();
  if (keys) config.seals = &*keys;
  MapServer server(database, listener, epoch, config);
  out << "listening on " << listener.text() << ", writing " << options.database << std::endl;
  std::optional<LiveView> view;
  if (!options.http.empty()) {
    view.emplace(options, server);
    out << "live page " << view->link() << std::endl;
  }
  const double period_ms = static_cast<double>(config.commit_period_us) / 2000.0;
  const int wait_ms = std::max(1, static_cast<int>(period_ms / options.time_scale));
  {
    ProgressLine status;
    TimeUs next_step_us = 0;
    while (!stop) {
      listener.wait(wait_ms);
      const TimeUs now_us = clock.now_us();
      receive_all(listener, server, now_us);
      if (view) view->update(server, database, now_us);
      if (now_us < next_step_us) continue;  // a step looks at every robot
      next_step_us = now_us + config.commit_period_us / kStepsPerCommit;
      server.step(now_us);
      status.say(summary(server, now_us));
    }
  }
  receive_all(listener, server, clock.now_us());
  server.finish(clock.now_us());
  database.end_session(unix_time_us());
  out << summary(server, clock.now_us()) << std::endl;
}

void add_serve_command(CLI::App& app, CommandAction& action) {
  CLI::App* command = app.add_subcommand("serve", "Merge the robots' maps and share them (UDP)");
  auto options = std::make_shared<ServeOptions>();
  command->add_option("--listen", options->listen, "HOST:PORT for the robots; port 0: a free one")
      ->capture_default_str();
  command->add_option("--db", options->database, "run database; an existing one is continued")
      ->capture_default_str();
  command->add_option("--http", options->http,
                      "HOST:PORT of the live page, or PORT for this machine only");
  command
      ->add_option("--retention", options->retention_s,
                   "how long poses, status and traffic are kept, such as 12h or 7d; the map stays "
                   "[for ever]")
      ->transform(CLI::AsNumberWithUnit(
          std::map<std::string, double>{{"s", 1}, {"min", 60}, {"h", 3600}, {"d", 86400}}))
      ->check(CLI::PositiveNumber);
  command->add_option("--keys", options->keys,
                      "file with the robots' radio keys (ivfm keygen); without it robots are heard "
                      "on this machine only");
  command->add_option("--model", options->model,
                      "of the robots, for the page's Q map [the first of models/*.ivfm]");
  command
      ->add_option("--visit-range", options->visit_range_m,
                   "of the robots in metres, for the page's local map")
      ->check(CLI::Range(0.1, 12.0))
      ->capture_default_str();
  command
      ->add_option("--explorable", options->explorable_m2,
                   "square metres that there are to see, if known: the page shows the share")
      ->check(CLI::PositiveNumber);
  command->add_option("--time-scale", options->time_scale, "times faster than the wall clock")
      ->check(CLI::Range(0.01, 1000.0))
      ->capture_default_str();
  command->footer(
      "Example: ivfm serve --listen 0.0.0.0:7700 --keys keys/server.keys --db run.db --http 8080");
  command->callback([options, &action] {
    action = [options] {
      std::signal(SIGINT, request_stop);
      std::signal(SIGTERM, request_stop);
      serve(*options, stop_requested, std::cout);
      return 0;
    };
  });
}

}  // namespace ivfm::host
