#include "host/evaluation/evaluator.h"

#include <atomic>
#include <chrono>
#include <exception>
#include <mutex>
#include <stdexcept>
#include <thread>

#include "host/environment/random.h"
#include "host/evaluation/policies/exploration_policy.h"

namespace ivfm::host {

namespace {

// The seed of one episode, and of what its policy draws.
std::uint64_t episode_seed(std::uint64_t seed, int episode) {
  return Random(seed, static_cast<std::uint64_t>(episode)).next();
}

class Worker {
 public:
  Worker(const EvaluationRequest& request)
      : request_(request),
        env_(request.world.config),
        policy_(make_policy(request.policy, request.world.config, request.model)) {}

  EpisodeMetrics run(int episode) {
    const std::uint64_t seed = episode_seed(request_.seed, episode);
    env_.reset(request_.world.scenario(request_.agents, seed));
    policy_->start_episode(Random(seed, 1).next());
    std::vector<std::int64_t> sim_steps(static_cast<std::size_t>(env_.agents()), 0);
    std::array<std::optional<double>, kMilestones.size()> reached{};
    while (!env_.is_done()) {
      const int agent = env_.next_agent();
      sim_steps[static_cast<std::size_t>(agent)] += policy_->act(env_, agent).sim_steps;
      ++decisions_;
      for (std::size_t i = 0; i < reached.size(); ++i) {
        if (reached[i] || env_.totals().coverage() < kMilestones[i]) continue;
        reached[i] = env_.totals().total_distance_m();
      }
    }
    EpisodeMetrics metrics = measured(env_, sim_steps, request_.state == "vfm" ? 4 : 2);
    metrics.seed = seed;
    metrics.milestone_m = reached;
    return metrics;
  }

  std::int64_t decisions() const { return decisions_; }

 private:
  const EvaluationRequest& request_;
  ExplorationEnvironment env_;
  std::unique_ptr<ExplorationPolicy> policy_;
  std::int64_t decisions_ = 0;
};

// What the workers share.
struct Shared {
  std::atomic<int> next{0};
  std::mutex mutex;  // for all below
  int finished = 0;
  std::exception_ptr error;
};

void work(const EvaluationRequest& request, const std::function<void(int)>& progress,
          Shared& shared, EvaluationResult& result) {
  try {
    const auto started = std::chrono::steady_clock::now();
    Worker worker(request);
    for (int i = shared.next++; i < request.episodes; i = shared.next++) {
      const EpisodeMetrics metrics = worker.run(i);
      const std::lock_guard lock(shared.mutex);
      if (shared.error) return;
      result.episodes[static_cast<std::size_t>(i)] = metrics;
      ++shared.finished;
      if (progress) progress(shared.finished);
    }
    const std::chrono::duration<double> busy = std::chrono::steady_clock::now() - started;
    const std::lock_guard lock(shared.mutex);
    result.decisions += worker.decisions();
    result.busy_s += busy.count();
  } catch (...) {
    const std::lock_guard lock(shared.mutex);
    if (!shared.error) shared.error = std::current_exception();
    shared.next = request.episodes;
  }
}

}  // namespace

EvaluationResult evaluate(const EvaluationRequest& request,
                          const std::function<void(int)>& progress) {
  if (request.episodes < 1) throw std::invalid_argument("--episodes must be at least 1");
  EvaluationResult result;
  result.episodes.resize(static_cast<std::size_t>(request.episodes));
  Shared shared;
  std::vector<std::jthread> threads;
  for (int i = 1; i < request.threads; ++i) {
    threads.emplace_back([&] { work(request, progress, shared, result); });
  }
  work(request, progress, shared, result);
  threads.clear();  // joins
  if (shared.error) std::rethrow_exception(shared.error);
  return result;
}

}  // namespace ivfm::host
