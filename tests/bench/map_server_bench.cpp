// The map server under the load of 1,000 robots on loopback, against what the machine can do at
// all: UDP echoes and plain SQLite inserts, measured in the same run. Bounded in count and time.
#include <pthread.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <ctime>
#include <filesystem>
#include <functional>
#include <memory>
#include <sstream>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "firmware/hal/linux/udp_socket.h"
#include "host/map_server/run_database.h"
#include "host/map_server/serve_command.h"
#include "host/map_server/udp_listener.h"
#include "tests/bench/robot_load.h"

namespace ivfm::host {
namespace {

constexpr std::size_t kDatagramBytes = 200;  // of an echo; about what a robot's update has
constexpr std::size_t kInsertsPerCommit = 100;

// Runs `work` until it is told to stop; knows how much processor time that took.
class Worker {
 public:
  explicit Worker(std::function<void(const std::atomic<bool>&)> work)
      : thread_([this, work = std::move(work)] { work(stop_); }) {
    pthread_getcpuclockid(thread_.native_handle(), &clock_);
  }
  ~Worker() { stop(); }
  void stop() {
    stop_ = true;
    if (thread_.joinable()) thread_.join();
  }
  double cpu_s() const {
    timespec time{};
    clock_gettime(clock_, &time);
    return static_cast<double>(time.tv_sec) + static_cast<double>(time.tv_nsec) / 1e9;
  }

 private:
  std::atomic<bool> stop_{false};
  std::thread thread_;
  clockid_t clock_{};
};

double seconds_since(std::chrono::steady_clock::time_point begin) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}

void print(const char* what, std::uint64_t count, double seconds, double cpu_s) {
  std::printf("%-44s %10.0f /s   %10.0f /s of one core\n", what,
              static_cast<double>(count) / seconds, static_cast<double>(count) / cpu_s);
  std::fflush(stdout);
}

void echo(UdpListener& listener, const std::atomic<bool>& stop) {
  std::array<std::uint8_t, 2000> buffer;
  while (!stop) {
    listener.wait(50);
    while (const auto datagram = listener.receive(buffer)) {
      listener.send(datagram->second, std::span(buffer).first(datagram->first));
    }
  }
}

// `robots` sockets, each with one datagram on its way at any time.
void measure_echo(int robots, double seconds) {
  UdpListener listener("127.0.0.1:0");
  Worker server([&](const std::atomic<bool>& stop) { echo(listener, stop); });
  std::vector<std::unique_ptr<UdpSocket>> sockets;
  const std::vector<std::uint8_t> datagram(kDatagramBytes, 7);
  for (int i = 0; i < robots; ++i) {
    sockets.push_back(std::make_unique<UdpSocket>(listener.text()));
    static_cast<void>(sockets.back()->send(datagram));
  }
  std::array<std::uint8_t, 2000> buffer;
  std::uint64_t echoes = 0;
  const auto begin = std::chrono::steady_clock::now();
  const double cpu_before_s = server.cpu_s();
  while (seconds_since(begin) < seconds) {
    for (const auto& socket : sockets) {
      if (!socket->receive(buffer).ok()) continue;
      ++echoes;
      static_cast<void>(socket->send(datagram));
    }
  }
  print("UDP echo", echoes, seconds_since(begin), server.cpu_s() - cpu_before_s);
}

// Rows of a tile's size, durable a hundred at a time; nothing else.
void measure_inserts(const std::filesystem::path& folder, double seconds) {
  std::uint64_t rows = 0;
  double wall_s = 0;
  std::atomic<double> cpu_s{0};
  {
    Worker worker([&](const std::atomic<bool>& stop) {
      SqliteConnection connection(folder / "inserts.db", SqliteConnection::Mode::kWrite);
      connection.execute(
          "PRAGMA journal_mode = WAL; PRAGMA synchronous = FULL; "
          "CREATE TABLE rows (number INTEGER PRIMARY KEY, cells BLOB NOT NULL)");
      SqliteStatement insert(connection, "INSERT INTO rows VALUES (?, ?)");
      const std::vector<std::uint8_t> cells(1024, 3);
      const auto begin = std::chrono::steady_clock::now();
      while (!stop && seconds_since(begin) < seconds) {
        connection.execute("BEGIN IMMEDIATE");
        for (std::size_t i = 0; i < kInsertsPerCommit; ++i) {
          insert.bind(static_cast<std::int64_t>(++rows))
              .bind(std::span<const std::uint8_t>(cells))
              .run();
        }
        connection.execute("COMMIT");
      }
      wall_s = seconds_since(begin);
      timespec time{};
      clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
      cpu_s = static_cast<double>(time.tv_sec) + static_cast<double>(time.tv_nsec) / 1e9;
    });
    std::this_thread::sleep_for(std::chrono::duration<double>(seconds + 0.2));
  }
  print("SQLite inserts of 1 KiB, 100 a transaction", rows, wall_s, cpu_s);
}

// What the server says, readable while it runs.
class ServerThread {
 public:
  explicit ServerThread(const std::filesystem::path& database)
      : address_(free_address()), worker_([this, database](const std::atomic<bool>& stop) {
          ServeOptions options;
          options.listen = address_;
          options.database = database.string();
          std::ostringstream out;
          serve(options, stop, out);
        }) {}
  const std::string& address() const { return address_; }
  double cpu_s() const { return worker_.cpu_s(); }

 private:
  static std::string free_address() { return UdpListener("127.0.0.1:0").text(); }
  std::string address_;
  Worker worker_;
};

void measure_server(const ServerThread& server, const LoadOptions& load, const char* what) {
  RobotLoad robots(load);
  const double cpu_before_s = server.cpu_s();
  const LoadReport report = robots.run();
  if (report.updates == 0) throw std::runtime_error("not one update became durable");
  print(what, report.updates, report.seconds, server.cpu_s() - cpu_before_s);
  std::printf(
      "  acknowledged after %.0f ms (median), %.0f ms (99 %%); %.0f bytes and %.3f "
      "repetitions an update\n",
      report.percentile_s(0.5) * 1e3, report.percentile_s(0.99) * 1e3,
      static_cast<double>(report.bytes_sent) / static_cast<double>(report.updates),
      static_cast<double>(report.retransmissions) / static_cast<double>(report.updates));
  std::fflush(stdout);
}

// From opening the database to the map in memory.
void measure_start(const std::filesystem::path& database) {
  const auto begin = std::chrono::steady_clock::now();
  RunDatabase file(database);
  MapStore map;
  file.load_tiles(map);
  std::printf("%-44s %10.2f s for %zu tiles, %.0f MiB of database\n", "Start from the database",
              seconds_since(begin), map.tile_count(),
              static_cast<double>(file.file_bytes()) / (1 << 20));
}

int run(int robots, double seconds, const std::filesystem::path& folder) {
  std::filesystem::create_directories(folder);
  std::printf("%d robots on loopback, database in %s\n", robots, folder.c_str());
  measure_echo(robots, seconds / 5);
  measure_inserts(folder, seconds / 5);
  {
    const ServerThread server(folder / "run.db");
    LoadOptions load{server.address(), robots, seconds, 1};
    measure_server(server, load, "Map updates made durable, one a second each");
    load.updates_per_second = 0;
    measure_server(server, load, "Map updates made durable, as many as go");
  }
  measure_start(folder / "run.db");
  return 0;
}

}  // namespace
}  // namespace ivfm::host

int main(int argc, char** argv) {
  int robots = 1000;
  double seconds = 10;
  std::string parent = "/tmp";
  CLI::App app{"The map server under load"};
  app.add_option("--robots", robots, "how many")->check(CLI::Range(1, 4096))->capture_default_str();
  app.add_option("--seconds", seconds, "of each load")
      ->check(CLI::Range(1.0, 600.0))
      ->capture_default_str();
  app.add_option("--folder", parent, "for the databases; on a real disk")->capture_default_str();
  CLI11_PARSE(app, argc, argv);
  const auto folder =
      std::filesystem::path(parent) / ("ivfm-map-server-bench-" + std::to_string(::getpid()));
  try {
    const int code = ivfm::host::run(robots, seconds, folder);
    std::filesystem::remove_all(folder);
    return code;
  } catch (const std::exception& error) {
    std::fprintf(stderr, "map_server_bench: %s\n", error.what());
    std::filesystem::remove_all(folder);
    return 1;
  }
}
