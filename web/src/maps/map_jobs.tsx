import { ask } from '../api/client.js';
import { isOver, type Job } from '../jobs/job.js';
import { JobTable } from '../jobs/job_table.js';
import { linkTo } from '../state/router.js';
import { useLoad } from '../ui/load.js';

const kShown = 5;

/** The latest jobs of a map; nothing if there are none. */
export function MapJobs({ map, onEnd }: { map: string; onEnd: () => void }) {
  const { data, reload } = useLoad(
    async (signal) => (await ask('get', '/v1/jobs', { query: { map, limit: kShown }, signal })).data, [map], { everyS: 4 });
  if (data === undefined || data.jobs.length === 0) return null;
  const jobs = data.jobs as Job[];
  const ended = (): void => {
    reload();
    onEnd();
  };
  return (
    <section aria-labelledby="jobs">
      <div class="heading">
        <h2 id="jobs">Jobs</h2>
        <span class="grow" />
        {data.next !== null && <a href={linkTo('jobs', [], { map })}>All jobs of this map</a>}
      </div>
      <JobTable jobs={jobs} live={jobs.find((job) => !isOver(job))?.id} onEnd={ended} oneMap />
    </section>
  );
}
