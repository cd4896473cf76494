#include "host/evaluation/process_group.h"

#include <mpi.h>

#include <cstdlib>

namespace ivfm::host {

namespace {

constexpr int kFirst = 0;
constexpr int kTag = 1;

// Errors of MPI calls end the whole job: that is MPI's default and all that one can do.
class MpiGroup final : public ProcessGroup {
 public:
  MpiGroup() {
    int provided = 0;
    MPI_Init_thread(nullptr, nullptr, MPI_THREAD_FUNNELED, &provided);
    MPI_Comm_rank(MPI_COMM_WORLD, &rank_);
    MPI_Comm_size(MPI_COMM_WORLD, &size_);
    MPI_Comm machine = MPI_COMM_NULL;
    MPI_Comm_split_type(MPI_COMM_WORLD, MPI_COMM_TYPE_SHARED, rank_, MPI_INFO_NULL, &machine);
    MPI_Comm_size(machine, &local_size_);
    MPI_Comm_free(&machine);
  }
  ~MpiGroup() override { MPI_Finalize(); }

  int rank() const override { return rank_; }
  int size() const override { return size_; }
  int local_size() const override { return local_size_; }

  std::string broadcast(std::string text) override {
    auto bytes = static_cast<unsigned long long>(text.size());
    MPI_Bcast(&bytes, 1, MPI_UNSIGNED_LONG_LONG, kFirst, MPI_COMM_WORLD);
    text.resize(bytes);
    constexpr std::size_t kPart = 1 << 30;  // MPI counts in int
    for (std::size_t at = 0; at < text.size(); at += kPart) {
      const auto part = static_cast<int>(std::min(kPart, text.size() - at));
      MPI_Bcast(text.data() + at, part, MPI_CHAR, kFirst, MPI_COMM_WORLD);
    }
    return text;
  }

  void send_to_first(const std::string& message) override {
    MPI_Send(message.data(), static_cast<int>(message.size()), MPI_CHAR, kFirst, kTag,
             MPI_COMM_WORLD);
  }

  std::optional<std::string> receive() override {
    int there = 0, bytes = 0;
    MPI_Status status;
    MPI_Iprobe(MPI_ANY_SOURCE, kTag, MPI_COMM_WORLD, &there, &status);
    if (there == 0) return std::nullopt;
    MPI_Get_count(&status, MPI_CHAR, &bytes);
    std::string message(static_cast<std::size_t>(bytes), '\0');
    MPI_Recv(message.data(), bytes, MPI_CHAR, status.MPI_SOURCE, kTag, MPI_COMM_WORLD,
             MPI_STATUS_IGNORE);
    return message;
  }

  void abort() override { MPI_Abort(MPI_COMM_WORLD, 1); }

 private:
  int rank_ = 0, size_ = 1, local_size_ = 1;
};

}  // namespace

std::unique_ptr<ProcessGroup> join_process_group() {
  // Open MPI's mpirun sets it for every process that it starts.
  if (std::getenv("OMPI_COMM_WORLD_SIZE") == nullptr) return std::make_unique<ProcessGroup>();
  return std::make_unique<MpiGroup>();
}

}  // namespace ivfm::host
