import { ask } from '../api/client.js';
import { useLoad } from '../ui/load.js';
import { Trouble } from '../ui/parts.js';
import type { ViewProps } from '../views.js';

export default function JobsView(_: ViewProps) {
  const { data, error, reload } = useLoad((signal) => ask('get', '/v1/jobs', { signal }), []);
  return (
    <>
      <h1>Jobs</h1>
      {error !== undefined && <Trouble error={error} onRetry={reload} />}
      <ul>{data?.data.jobs.map((job) => <li key={job.id}>{job.id}</li>)}</ul>
    </>
  );
}
