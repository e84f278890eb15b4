#pragma once
#include <string>

#include "tools/checks/core/host.hpp"

/// What is seen of this host, without a config and without gRPC. Changes nothing.
namespace ledgerline::checks {

/// Where `file` is written, or would be.
DirectoryInputs probe_directory(const std::string& file);
/// Asks the kernel (adjtimex(2)), which takes no rights.
ClockInputs probe_clock();
/// What `link`, its process, has, or else (0) what this user may have.
RealTimeInputs probe_real_time(bool wanted, int link);
SharedMemoryInputs probe_shared_memory();
/// Whether a program could have a UDP port, which it takes for a moment: of link's not while link runs.
PortInputs probe_port(const std::string& listen);
InterfaceInputs probe_interface(const std::string& name, const std::string& whose);
/// The way that the kernel would take; nothing is sent.
RouteInputs probe_route(const std::string& drone, const std::string& address, const std::string& wanted);
/// Whether link runs here, by its socket.
bool is_link_running();

}  // namespace ledgerline::checks
