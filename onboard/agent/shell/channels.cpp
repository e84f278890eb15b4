#include "onboard/agent/shell/channels.hpp"

namespace ledgerline::agent {

std::vector<Settings> settings_of_channels(const Settings& process, const fabric::Channels& channels) {
  std::vector<Settings> all;
  for (std::size_t i = 0; i < channels.all.size(); ++i) {
    Settings one = process;
    one.core.drones.clear();
    for (std::size_t drone = 0; drone < process.core.drones.size(); ++drone) {
      if (channels.of_drone[drone] == i) one.core.drones.push_back(process.core.drones[drone]);
    }
    one.core.check.where = {channels.all[i].name, channels.all[i].contract};
    one.core.seed += i;  // so that their back-offs do not go in step
    one.checkpoint = fabric::file_of_channel(process.checkpoint, channels, i);
    all.push_back(std::move(one));
  }
  return all;
}

}  // namespace ledgerline::agent
