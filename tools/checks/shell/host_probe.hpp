#pragma once
#include <string>

#include "tools/checks/core/host.hpp"

/// Looks at this host; changes nothing.
namespace ledgerline::checks {

/// Where `file` is written, or would be.
DirectoryFacts look_at_folder_of(const std::string& file);
/// Asks the kernel (adjtimex(2)), which takes no rights.
ClockFacts look_at_clock();
RealTimeFacts look_at_real_time(bool wanted);
SharedMemoryFacts look_at_shared_memory();
/// Whether a program could have a UDP port, which it takes for a moment: of link's not while link runs.
PortFacts look_at_port(const std::string& listen);
InterfaceFacts look_at_interface(const std::string& name, const std::string& whose);
/// The way that the kernel would take; nothing is sent.
RouteFacts look_at_route(const std::string& drone, const std::string& address, const std::string& wanted);
/// Whether link runs here, by its socket.
bool link_runs();

}  // namespace ledgerline::checks
