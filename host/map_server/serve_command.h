// `ivfm serve`: the map server as a process.
#pragma once

#include <atomic>
#include <iosfwd>
#include <string>

#include "host/cli/commands.h"

namespace ivfm::host {

struct ServeOptions {
  std::string listen = "127.0.0.1:7700";  // HOST:PORT; port 0 takes a free one
  std::string database = "run.db";
  std::string http;          // of the live page; empty: none
  std::string model;         // of the robots, for the page's Q map; empty: the shipped one, if any
  double visit_range_m = 3;  // of the robots, for the page's local map
  double explorable_m2 = 0;  // what there is to see, for the page's share; 0: nobody knows
  double retention_s = 0;    // of the log in the database; 0: for ever
  double time_scale = 1.0;   // how many seconds pass for the server in one second
  std::string keys;          // file with the robots' keys; empty: no encryption, loopback only
};

// Serves until `stop` becomes true. Says on `out` where it listens, then at the end what it holds.
// Throws std::runtime_error with one sentence when it cannot start or go on.
void serve(const ServeOptions& options, const std::atomic<bool>& stop, std::ostream& out);

void add_serve_command(CLI::App& app, CommandAction& action);

}  // namespace ivfm::host
