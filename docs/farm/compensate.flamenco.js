// A job type of Flamenco 3 (Blender's render farm): domesim compensate, a range of frames to a task, and a last
// task that reads all results again and writes the report. Records beside the results keep what is done, so that
// tasks may be tried again, in any order, on any worker. Put this file into the Manager's folder "scripts".
const JOB_TYPE = {
    label: "domesim compensate",
    settings: [
        { key: "master", type: "string", required: true,
          description: "Numbered sequence of domemasters, such as /show/masters/show.####.exr" },
        { key: "scene", type: "string", default: "dome_imax", description: "Theatre, by name or path" },
        { key: "out", type: "string", subtype: "dir_path", required: true,
          description: "Folder for the frames to project, and the job's records" },
        { key: "frames", type: "string", required: true, description: "Which frames, such as 1-36000" },
        { key: "chunk_size", type: "int32", default: 12, description: "Frames to a task: a start takes a second" },
    ],
};

function compileJob(job) {
    const { master, scene, out, frames, chunk_size } = job.settings;
    const command = ["compensate", master, "--scene", scene, "--out", out];
    const report = author.Task("report", "misc");
    report.addCommand(author.Command("exec", { exe: "domesim", args: command }));
    for (const chunk of frameChunker(frames, chunk_size)) {
        const task = author.Task(`compensate-${chunk}`, "misc");
        const args = command.concat(["--frames", chunk, "--pages", "0"]);
        task.addCommand(author.Command("exec", { exe: "domesim", args }));
        report.addDependency(task);
        job.addTask(task);
    }
    job.addTask(report);
}
