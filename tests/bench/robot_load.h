// Many robots without bodies: each sends map updates as a real one does, over its own UDP socket,
// and takes the time until the server says that they are durable.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace ivfm::host {

struct LoadOptions {
  std::string server;             // HOST:PORT, on this machine
  int robots = 1000;              // at most 4,096
  double seconds = 10;            // at most 600
  double updates_per_second = 1;  // of each robot; 0: the next as soon as the last is durable
};

struct LoadReport {
  double seconds = 0;
  std::uint64_t updates = 0;           // map updates that the server made durable
  std::uint64_t retransmissions = 0;   // of a datagram's rectangles
  std::uint64_t bytes_sent = 0;        // IP and UDP headers included
  std::vector<double> acknowledged_s;  // of each, from sending to acknowledgement; sorted
  // The time within which a share (0 .. 1) of the updates was acknowledged.
  double percentile_s(double share) const;
};

// Runs in this thread for as long as it is told. Throws std::runtime_error when the server's
// address or the numbers cannot be used.
class RobotLoad {
 public:
  explicit RobotLoad(const LoadOptions& options);
  ~RobotLoad();
  RobotLoad(const RobotLoad&) = delete;
  RobotLoad& operator=(const RobotLoad&) = delete;

  // Until every robot has been greeted, then `options.seconds`.
  LoadReport run();

 private:
  class Robot;
  LoadOptions options_;
  std::vector<std::unique_ptr<Robot>> robots_;
};

}  // namespace ivfm::host
