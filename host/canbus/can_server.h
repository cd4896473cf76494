// A CAN bus in user space: serves the socketcand protocol over TCP to several clients and buses.
#pragma once

#include <atomic>
#include <cstdint>
#include <fstream>
#include <list>
#include <string>
#include <string_view>
#include <vector>

#include "firmware/hal/linux/socketcand_protocol.h"

namespace ivfm::host {

struct CanServerOptions {
  std::string host = "127.0.0.1";
  std::string port = "28600";         // "0": any free one, see CanServer::port()
  std::vector<std::string> buses;     // empty: a bus exists once a client opens it
  std::string log_path;               // candump format; empty: no log
  double time_scale = 1.0;            // how much faster the time stamps run than the clock
  std::size_t max_backlog = 1 << 18;  // bytes that may wait for a slow client
};

// Poll-based, one thread. Every frame that a client sends goes to the other clients in raw mode on
// the same bus, in order, as on a wire; clients in the broadcast manager mode may send only.
class CanServer {
 public:
  struct Counters {
    std::uint64_t frames = 0;
    std::uint64_t clients = 0;
    std::uint64_t malformed = 0;     // messages answered with an error
    std::uint64_t slow_clients = 0;  // dropped because they did not read
  };

  // Listens. Throws std::runtime_error with one sentence: address unknown or in use, log
  // unwritable.
  explicit CanServer(const CanServerOptions& options);
  ~CanServer();
  CanServer(const CanServer&) = delete;
  CanServer& operator=(const CanServer&) = delete;

  // Where it listens.
  std::uint16_t port() const { return port_; }
  // Serves what there is to serve, waiting at most `timeout_ms` for something.
  void poll_once(int timeout_ms);
  // Serves until stop() is called, from another thread or a signal handler.
  void run();
  void stop();
  // Of this moment; from any thread.
  Counters counters() const { return {frames_, client_count_, malformed_, slow_clients_}; }

 private:
  enum class Mode : std::uint8_t { kNoBus, kBroadcast, kRaw, kControl };
  struct Client {
    int fd = -1;
    Mode mode = Mode::kNoBus;
    std::string bus;
    SocketcandTokenizer tokenizer;
    std::uint32_t oversized_told = 0;
    std::string out;
    std::uint64_t hold_until_us = 0;  // see set_mode()
    bool closing = false;             // once `out` is sent
    bool gone = false;
  };

  void listen_on(const CanServerOptions& options);
  void accept_clients();
  void read_client(Client& client);
  void on_message(Client& client, std::string_view message);
  void on_open(Client& client, std::string_view message);
  bool set_mode(Client& client, std::string_view message);
  void on_send(Client& client, std::string_view message);
  void deliver(const Client* from, const std::string& bus, const SocketcandFrame& frame);
  void log(std::uint64_t time_us, const std::string& bus, const SocketcandFrame& frame);
  void answer(Client& client, std::string_view text);
  void refuse(Client& client, std::string_view why);
  void flush(Client& client);
  void drop_gone();
  std::uint64_t time_stamp_us() const;

  CanServerOptions options_;
  int listener_ = -1;
  int wake_ = -1;
  std::uint16_t port_ = 0;
  std::atomic<bool> stopping_{false};
  std::list<Client> clients_;
  std::ofstream log_;
  std::uint64_t log_flush_us_ = 0;
  std::uint64_t start_wall_us_ = 0;
  std::uint64_t start_us_ = 0;
  std::atomic<std::uint64_t> frames_{0};
  std::atomic<std::uint64_t> client_count_{0};
  std::atomic<std::uint64_t> malformed_{0};
  std::atomic<std::uint64_t> slow_clients_{0};
};

// "(1436509052.249713) can0 123#AABB\n", the line that candump -L writes.
std::string format_candump(std::uint64_t time_us, std::string_view bus,
                           const SocketcandFrame& frame);

}  // namespace ivfm::host
