#pragma once
#include <string>

#include "tools/doctor/core/host.hpp"

/// Looks at this host; changes nothing.
namespace ledgerline::doctor {

/// Where `file` is written, or would be.
DirectoryFacts look_at_folder_of(const std::string& file);
ClockFacts look_at_clock();
RealTimeFacts look_at_real_time(bool wanted);
SharedMemoryFacts look_at_shared_memory();
/// Whether link could have its port, which it takes for a moment: not while link runs.
StatePortFacts look_at_state_port(const std::string& listen);
InterfaceFacts look_at_interface(const std::string& name, const std::string& whose);
/// The way that the kernel would take; nothing is sent.
RouteFacts look_at_route(const std::string& drone, const std::string& address, const std::string& wanted);
/// Whether link runs here, by its socket.
bool link_runs();

}  // namespace ledgerline::doctor
