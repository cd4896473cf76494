// The float network as an ONNX file, for Netron, OpenCV and other tools.
#pragma once

#include <filesystem>
#include <string>

#include "host/quantizer/float_network.h"

namespace ivfm::host {

// The bytes of an ONNX model (operator set 10). Input "state": float, 1 x channels x 32 x 32, the
// state encoder's uint16 values as they are; output "q": float, 1 x 1 x 32 x 32. Both row by row
// from the lowest row, as everywhere. Throws as FloatNetwork::shapes().
std::string to_onnx(const FloatNetwork& network);

// Throws std::runtime_error with the path when it cannot be written.
void save_onnx(const FloatNetwork& network, const std::filesystem::path& path);

}  // namespace ivfm::host
