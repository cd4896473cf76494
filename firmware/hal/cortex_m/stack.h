// How much of the stack has ever been used; it is painted before main().
#pragma once

#include <cstddef>

namespace ivfm {

std::size_t stack_size();  // bytes
std::size_t stack_used();  // bytes, the most so far

}  // namespace ivfm
