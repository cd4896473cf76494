// The processes that share an evaluation: those that mpirun started, or this one alone. The only
// place that knows of MPI.
#pragma once

#include <memory>
#include <optional>
#include <string>

namespace ivfm::host {

class ProcessGroup {
 public:
  virtual ~ProcessGroup() = default;
  virtual int rank() const { return 0; }
  virtual int size() const { return 1; }
  // Processes of the group on this machine.
  virtual int local_size() const { return 1; }
  bool is_first() const { return rank() == 0; }

  // The first process' text, for all of them. Every process must call it.
  virtual std::string broadcast(std::string text) { return text; }
  // For the first process; from the others.
  virtual void send_to_first(const std::string& message) { (void)message; }
  // The next message of another process, on the first one, if there is one.
  virtual std::optional<std::string> receive() { return std::nullopt; }
  // Ends every process of the group, with exit code 1. Alone it returns.
  virtual void abort() {}
};

// All processes of the group must call it, once. Without mpirun MPI is not even started. Only the
// thread that called it may use the group.
std::unique_ptr<ProcessGroup> join_process_group();

}  // namespace ivfm::host
