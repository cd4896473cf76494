// docs/results.md: the paper's tables beside ours, comparisons, plots and pictures.
#pragma once

#include <filesystem>
#include <string>

#include "host/evaluation/paper_evaluation.h"

namespace ivfm::host {

// What stands above the results: how to make them again.
struct Provenance {
  std::string commit;
  std::string command;
};

// The tables for a terminal.
std::string paper_text(const PaperOutcome& outcome);

// Writes the document, and its plots and pictures into the folder beside it that is named like the
// document without ".md". Throws std::runtime_error with the path when something cannot be written.
void write_paper_document(const std::filesystem::path& file, const PaperRequest& request,
                          const PaperOutcome& outcome, const Provenance& provenance);

}  // namespace ivfm::host
