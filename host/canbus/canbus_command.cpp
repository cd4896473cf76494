#include "host/canbus/canbus_command.h"

#include <csignal>
#include <cstdio>
#include <memory>
#include <string>

#include "host/canbus/can_server.h"

namespace ivfm::host {
namespace {

CanServer* g_server = nullptr;  // the signal handler's

void on_signal(int) { g_server->stop(); }

struct CanbusOptions {
  std::string listen = "127.0.0.1:28600";
  CanServerOptions server;
};

int serve(CanbusOptions options) {
  const std::size_t colon = options.listen.rfind(':');
  options.server.host = options.listen.substr(0, colon);
  options.server.port = options.listen.substr(colon + 1);
  if (options.server.host.size() > 2 && options.server.host.front() == '[') {
    options.server.host = options.server.host.substr(1, options.server.host.size() - 2);
  }
  CanServer server(options.server);
  g_server = &server;
  struct sigaction action {};
  action.sa_handler = on_signal;
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
  std::printf("CAN bus: connect with --can socketcand:%s:%u/BUS\n", options.server.host.c_str(),
              unsigned{server.port()});
  std::fflush(stdout);
  server.run();
  const CanServer::Counters counters = server.counters();
  std::printf("CAN bus: %llu frames, %llu clients, %llu bad messages, %llu slow clients dropped\n",
              static_cast<unsigned long long>(counters.frames),
              static_cast<unsigned long long>(counters.clients),
              static_cast<unsigned long long>(counters.malformed),
              static_cast<unsigned long long>(counters.slow_clients));
  return 0;
}

std::string check_listen(const std::string& text) {
  const std::size_t colon = text.rfind(':');
  const bool good = colon != text.npos && colon + 1 < text.size() &&
                    text.find_first_not_of("0123456789", colon + 1) == text.npos;
  return good ? "" : "'" + text + "' is not HOST:PORT, e.g. 127.0.0.1:28600";
}

}  // namespace

void add_canbus_command(CLI::App& app, CommandAction& action) {
  auto options = std::make_shared<CanbusOptions>();
  CLI::App* command =
      app.add_subcommand("canbus", "A CAN bus in user space, in the socketcand protocol");
  command->add_option("--listen", options->listen, "Where clients connect (port 0: any free one)")
      ->check(CLI::Validator(check_listen, "HOST:PORT"))
      ->capture_default_str();
  command->add_option("--bus", options->server.buses,
                      "Buses that exist; without it a bus exists once a client opens it");
  command->add_option("--log", options->server.log_path, "Writes every frame in candump format");
  command
      ->add_option("--time-scale", options->server.time_scale,
                   "How much faster than real time the time stamps run")
      ->check(CLI::Range(0.001, 1000.0))
      ->capture_default_str();
  command->footer(
      "Example:\n  ivfm canbus --listen 127.0.0.1:28600 --log can.log\n"
      "then, in python: can.interface.Bus(interface=\"socketcand\", host=\"127.0.0.1\", "
      "port=28600, channel=\"robot1\")");
  command->callback([options, &action] { action = [options] { return serve(*options); }; });
}

}  // namespace ivfm::host
