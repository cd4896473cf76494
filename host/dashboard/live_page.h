// The live page's web server: embedded files, changes of the map, commands for who has the token.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "host/dashboard/live_state.h"
#include "host/dashboard/local_view.h"
#include "shared/wire/messages.h"

namespace ivfm::host {

// What somebody at the page asks of one robot, or of all.
struct PageCommand {
  std::optional<std::uint16_t> robot;
  CommandCode code = CommandCode::kStop;
};

// 32 hexadecimal digits that nobody guesses.
std::string random_token();

// Serves in threads of its own from construction to destruction.
class LivePage {
 public:
  // `address`: HOST:PORT, or PORT for loopback only; port 0 takes a free one. Throws
  // std::runtime_error with one sentence when it cannot listen there. `state` outlives the page.
  LivePage(const std::string& address, const LiveState& state, std::string token);
  ~LivePage();
  LivePage(const LivePage&) = delete;
  LivePage& operator=(const LivePage&) = delete;

  // "http://127.0.0.1:8080/"
  std::string url() const;
  // The same with the token, for who may command the robots.
  std::string url_with_token() const;
  // From now on /api/local shows what a robot's policy sees. `view` outlives the page.
  void set_local_view(LocalView& view);
  // What /metrics answers from now on (Prometheus' text format).
  void set_metrics(std::string text);
  // What was asked since the last call, in order.
  std::vector<PageCommand> take_commands();

 private:
  class Server;
  std::unique_ptr<Server> server_;
};

}  // namespace ivfm::host
